"""All settings of ``mexecon+``, by room: those of its steps, which other methods have as well."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from methods.fit_settings import JMBO_PLUS, FitSettings
from methods.nview.settings import FusionSettings
from methods.stereo.settings import (
    CameraSettings,
    DentSettings,
    KeepRules,
    MatchSettings,
    NarrowSettings,
    StereoSettings,
    near_settings,
)


@dataclass(frozen=True, slots=True)
class FusedRooms:
    """All settings of the method, by room.

    Attributes:
        body: How the body is fitted.
        nview: How normals are estimated and the surface is made of them.
        match: How photos are matched around that surface, which is as often inside as outside.
        keep: Which points of it are kept.
        narrow: The search that finishes.
        dents: Which hollows of that surface photos are asked about.
        cameras: How cameras that contradict each other are corrected.
    """

    body: FitSettings = JMBO_PLUS
    nview: FusionSettings = field(default_factory=FusionSettings)
    match: MatchSettings = field(default_factory=lambda: near_settings().match)
    keep: KeepRules = field(default_factory=KeepRules)
    narrow: NarrowSettings = field(default_factory=NarrowSettings)
    dents: DentSettings = field(default_factory=DentSettings)
    cameras: CameraSettings = field(default_factory=CameraSettings)

    @property
    def stereo(self) -> StereoSettings:
        """Those of photo-consistency."""
        near = near_settings()
        return replace(
            near,
            match=self.match,
            keep=self.keep,
            narrow=self.narrow,
            dents=self.dents,
            cameras=self.cameras,
        )
