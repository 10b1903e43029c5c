"""The methods by name; third parties add theirs through the entry-point group harness.methods."""

from harness.core.process.registry import Registry

METHODS = Registry(
    "method",
    {
        "econ": "methods.mexecon:econ",
        "mexecon2": "methods.mexecon:mexecon2",
        "mexecon8": "methods.mexecon:mexecon8",
        "mexecon+": "methods.nview.method:mexecon_plus",
        "mexecon+two-sheets": "methods.mexecon:mexecon_plus_two_sheets",
        "body-front": "methods.body_fit:body_front",
        "body-average": "methods.body_fit:body_average",
        "jmbo8": "methods.body_fit:jmbo8",
        "jmbo8-no-head": "methods.body_fit:jmbo8_no_head",
        "jmbo8+": "methods.body_fit:jmbo8_plus",
        "oracle8": "methods.mexecon:oracle8",
        "vggt8": "methods.foreign.recipes:vggt8",
        "vggt2": "methods.foreign.recipes:vggt2",
        "da3-8": "methods.foreign.recipes:da3_8",
        "mapanything8": "methods.foreign.recipes:mapanything8",
        "pi3-8": "methods.foreign.recipes:pi3_8",
        "econ-authors": "methods.foreign.recipes:econ_authors",
        "mexecon-authors": "methods.foreign.recipes:mexecon_authors",
        "sith": "methods.foreign.recipes:sith",
        "pshuman": "methods.foreign.recipes:pshuman",
        "2dgs": "methods.foreign.recipes:gaussians_2d",
        "oracle8-points": "methods.from_points.oracle8:oracle8_points",
        "stereo8": "methods.stereo8:stereo8",
        "stereo8-psr": "methods.from_points.stereo8_psr:stereo8_psr",
        "hull8": "methods.hull:hull8",
        "hull": "methods.hull:hull",
        "gt": "methods.gt:gt",
    },
    group="harness.methods",
)
