"""The body fits that methods use: the published ones of ECON and MExECON, and ours."""

from __future__ import annotations

from dataclasses import replace

from methods.body.settings import FitSettings

#: MExECON's equation as it is printed, from the average of the single views.
JMBO = FitSettings()
#: ECON's fit to one view: equal weights, no head term.
ECON_FIT = replace(JMBO, normal=1.0, landmark=1.0, head=0.0, iterations=50)
#: Better on clothed people: starts from all landmarks, clothes may stand off, a weak prior, no
#: normal term. Chosen on training avatars, where the optimum is flat: half or twice a value costs
#: at most 0.6 mm.
JMBO_PLUS = FitSettings(
    start="landmarks",
    normals="off",
    landmarks="all",
    uncovered=0.1,
    standoff_m=0.01,
    landmark=0.4,
    prior=2e-4,
    iterations=60,
    early_stop=True,
    keep="best",
    schedule="ramp",
)
