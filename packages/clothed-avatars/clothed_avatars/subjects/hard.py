"""People that are hard to reconstruct: bare feet, long hair, a hood over the head, raised hands.

Body models end in shoes, hands at the sides and short hair; surfaces that are completed by one
balloon where it does not suit. Clothes crease as those of the second test set do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from clothed_avatars.clothes.wardrobe import (
    Fabric,
    Hair,
    Shoes,
    dress,
    hooded_sweater,
    loose_shirt,
    shorts,
    straight_trousers,
    t_shirt,
    wide_trousers,
)
from clothed_avatars.clothes.weaves import Worn, woven
from clothed_avatars.people.poses import Limb, Pose
from clothed_avatars.subjects.written import Person, Subject

_REVISION = 1
"""Changes whenever the same list gives other shapes."""

_STRAIGHT = Limb((90, 86), (120, 88))
_HANDS_UP = Pose(
    (Limb((85, -18), (40, -74)), Limb((80, -10), (55, -66))),
    (Limb((85, 82), (110, 87)), Limb((80, 82), (120, 87))),
    trunk=(2, 4, 0),
    head=(-6, 6, 0),
)
_SURRENDER = Pose(
    (Limb((95, 4), (60, -80)), Limb((95, 0), (70, -78))),
    (Limb((85, 78), (100, 84)), Limb((85, 78), (100, 84))),
    head=(4, -8, 0),
)
_STRIDE = Pose(
    (Limb((25, 58), (5, 34)), Limb((150, 60), (70, 62))),
    (Limb((165, 78), (175, 58)), Limb((12, 68), (150, 88))),
    trunk=(4, 6, 0),
)
_WIDE_ARMS = Pose(
    (Limb((80, 18), (20, 4)), Limb((100, 34), (40, 30))),
    (Limb((60, 84), (120, 88)), _STRAIGHT),
    trunk=(0, -8, 3),
    head=(0, -12, 4),
)
_CROUCH = Pose(
    (Limb((40, 10), (-10, -52)), Limb((60, 48), (10, 10))),
    (Limb((38, 42), (165, 62)), Limb((30, 50), (160, 68))),
    trunk=(10, 0, 0),
    head=(-8, 0, 0),
)


HARD_SUBJECTS: Mapping[str, Subject] = MappingProxyType(
    {
        "h01": Subject(
            Person(0.93, 0.68, 0.24, 0.48, 0.5, (222, 178, 150), Hair("bun", (60, 42, 32))),
            "hands up",
            t_shirt(woven(Fabric((60, 110, 160), "stripes", (230, 226, 214)), "jersey")),
            shorts(woven(Fabric((150, 136, 104)), "twill")),
            None,
            drawn_pose=_HANDS_UP,
            worn=Worn("jersey", "twill", 1.0, _REVISION),
        ),
        "h02": Subject(
            Person(0.06, 0.70, 0.33, 0.56, 0.6, (150, 104, 74), Hair("short", (34, 28, 26))),
            "striding",
            replace(hooded_sweater(woven(Fabric((88, 92, 104)), "knit")), collar="hood up"),
            straight_trousers(woven(Fabric((58, 76, 112), "denim", (122, 140, 170)), "denim")),
            None,
            drawn_pose=_STRIDE,
            worn=Worn("knit", "denim", 1.0, _REVISION),
        ),
        "h03": Subject(
            Person(0.97, 0.66, 0.34, 0.44, 0.45, (236, 198, 172), Hair("long", (176, 136, 84))),
            "arms spread",
            dress(woven(Fabric((150, 60, 72), "leaves", (234, 214, 190)), "poplin")),
            None,
            None,
            drawn_pose=_WIDE_ARMS,
            worn=Worn("poplin", None, 1.0, _REVISION),
        ),
        "h04": Subject(
            Person(0.12, 0.72, 0.40, 0.40, 0.7, (104, 72, 54), Hair("curly", (32, 28, 26))),
            "crouching",
            t_shirt(woven(Fabric((226, 222, 210)), "crumpled cotton"), chest=1.22, hem=0.11),
            shorts(woven(Fabric((70, 92, 128), "denim", (140, 158, 186)), "denim")),
            None,
            drawn_pose=_CROUCH,
            worn=Worn("crumpled cotton", "denim", 1.0, _REVISION),
        ),
        "h05": Subject(
            Person(0.90, 0.70, 0.26, 0.62, 0.45, (198, 150, 116), Hair("long", (46, 34, 28))),
            "hands up",
            loose_shirt(woven(Fabric((210, 170, 96), "checks", (120, 70, 50)), "poplin")),
            wide_trousers(woven(Fabric((60, 66, 62)), "twill")),
            Shoes((70, 66, 64), (40, 38, 38)),
            drawn_pose=_SURRENDER,
            worn=Worn("poplin", "twill", 1.0, _REVISION),
        ),
    }
)
