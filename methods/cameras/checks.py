"""When cameras that were found are not to be trusted, and how sure they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from harness.core.arrays import Floats
from harness.core.errors import MethodError
from harness.geometry.coinciding import components
from methods.cameras.adjustment import Rig, Rows, Solved
from methods.cameras.landmarks import landmark_spans
from methods.cameras.matches import (
    LEAST_MATCHES,
    Matches,
    MatchRows,
    contradiction_m,
    met,
    photo_pairs,
)
from methods.cameras.search import upright, upright_line
from methods.cameras.values import turn_sds_deg

#: Views that leave more than this unseen cannot be trusted; photos further apart are not matched.
_MOST_GAP_DEG, _MATCHED_DEG = 110.0, 65.0
#: Where a pair of photos has this many matches, clothes have features enough.
_PLENTY = 4 * LEAST_MATCHES
#: Matches that were held out lie this far from their epipolar lines at most, in the median, metres
#: at the subject; and two pairs of photos contradict each other by this much.
_MOST_OFF_M, _MOST_APART_M = 0.0012, 0.003
#: People who stand still have less than these of ``swayed``.
_MOST_BENT, _MOST_CONTRADICTED = 3.0, 1.1
#: Fewer points that two pairs see do not tell such people from chance.
_LEAST_TWICE = 2 * LEAST_MATCHES
#: Turns less sure than the first are warned of; a photo less sure than the second is left out, and
#: such a median refused, degrees. Where the median is weak, matches must miss by less than this.
_WEAK_SD_DEG, _MOST_SD_DEG, _WEAK_OFF_M = 0.5, 1.0, 0.0008
#: A photo whose matches miss by so many times the median photo's is left out.
_ODD = 2.0
#: A standard deviation is so many medians of the sizes.
_TYPICAL = 1.4826
#: So many ways in which all cameras together can move without a photo telling: turn, shift, scale.
_GAUGE = 7


def check_round(rig: Rig, left_out: Sequence[str] = ()) -> tuple[str, ...]:
    """Warnings of views that have no neighbour to be matched with.

    Args:
        rig: The views.
        left_out: What a refusal says of photos that are not among them.

    Raises:
        MethodError: the views leave a side of the person unseen.
    """
    up, centre = upright(rig), rig.points.mean(axis=0)
    away = rig.eyes - centre
    level = away - np.outer(away @ up, up)
    ahead = np.cross(np.eye(3)[int(np.argmin(np.abs(up)))], up)
    angles = np.degrees(np.arctan2(level @ np.cross(up, ahead), level @ ahead)) % 360
    ordered = np.sort(angles)
    gap_deg = float(np.diff(np.append(ordered, ordered[0] + 360)).max())
    if gap_deg > _MOST_GAP_DEG:
        raise MethodError(
            "the photos do not go round the person",
            expected=f"no gap of more than {_MOST_GAP_DEG:.0f} degrees",
            got="; ".join((f"{gap_deg:.0f} degrees that no photo shows", *left_out)),
            hint="Take photos from all sides, about 45 degrees apart",
        )
    if gap_deg > _MATCHED_DEG:
        text = f"two neighbouring photos are {gap_deg:.0f} degrees apart: they cannot be matched"
        return (text,)
    return ()


def misfit(found: Solved, matches: Matches) -> tuple[int, str] | None:
    """The view that is to be left out, and why.

    Its photo looks like none of its neighbours', though those look like others; its matches miss
    by far more than the others'; or outlines and matches leave its camera open, and no other.
    """
    if (view := _unmatched(found.rig, matches)) is not None:
        return view, "it looks like none of its neighbours"
    off_px = misses_px(found.rig, matches)
    if np.isfinite(off_px).any() and np.nanmax(off_px) > _ODD * np.nanmedian(off_px):
        view, usual_px = int(np.nanargmax(off_px)), float(np.nanmedian(off_px))
        return view, f"its matches miss by {off_px[view]:.1f} pixels, the others' by {usual_px:.1f}"
    sds_deg = turn_sds_deg(spreads(found)[0])
    view = int(np.argmax(sds_deg))
    if np.median(sds_deg) > _MOST_SD_DEG or sds_deg[view] <= _MOST_SD_DEG:
        return None
    return view, f"its camera is sure to {sds_deg[view]:.1f} degrees only"


def misses_px(rig: Rig, matches: Matches) -> Floats:
    """(C,) median distances of each photo's matches from their epipolar lines; NaN of few."""
    off_px = np.abs(met(rig, matches).off_px)
    own = [off_px[(matches.views == view).any(axis=1)] for view in range(len(rig))]
    return np.array([np.median(each) if len(each) >= LEAST_MATCHES else np.nan for each in own])


def _unmatched(rig: Rig, matches: Matches) -> int | None:
    pairs = photo_pairs(rig, rig.points.mean(axis=0))
    counts = matches.counts()
    each = np.array([counts.get(pair, 0) for pair in pairs])
    if not len(each) or np.median(each) < _PLENTY:
        return None
    own = np.array(
        [max((n for pair, n in zip(pairs, each, strict=True) if view in pair), default=_PLENTY)
         for view in range(len(rig))]
    )  # fmt: skip
    worst = int(np.argmin(own))
    return worst if own[worst] < LEAST_MATCHES else None


def check_matches(rig: Rig, matches: Matches) -> tuple[str, ...]:
    """Warnings of photos that tell too little.

    Raises:
        MethodError: matches contradict the cameras.
    """
    pairs = photo_pairs(rig, rig.points.mean(axis=0))
    counts = matches.counts()
    few = sum(counts.get(pair, 0) < LEAST_MATCHES for pair in pairs)
    off_m = missed_m(rig, matches)
    if np.isnan(off_m):
        return (
            "neighbouring photos have nearly nothing in common, as with plain clothes: the cameras "
            "are those of outlines alone, which are off by up to a pixel",
        )
    apart_m = contradiction_m(rig, matches)
    if off_m > _MOST_OFF_M or apart_m > _MOST_APART_M:
        apart = "" if np.isnan(apart_m) else f" and {1e3 * apart_m:.1f} mm"
        raise MethodError(
            "the photos contradict each other",
            expected=f"matches within {1e3 * _MOST_OFF_M:.1f} mm of what the cameras tell, and "
            f"places within {1e3 * _MOST_APART_M:.0f} mm",
            got=f"{1e3 * off_m:.1f} mm{apart}",
            hint="Probably the person moved between the photos",
        )
    warnings: list[str] = []
    if few:
        warnings.append(f"{few} of {len(pairs)} pairs of neighbouring photos have hardly a match")
    if (groups := _joined(len(rig), counts)) > 1:
        warnings.append(
            f"no matches join {groups} groups of photos: how they stand to each other follows from "
            "outlines alone, and may be off by more than is told"
        )
    bent, apart = swayed(rig, matches)
    if bent > _MOST_BENT or apart > _MOST_CONTRADICTED:
        warnings.append(
            "the person swayed between the photos, by 5 mm or more: expect errors of millimetres, "
            f"as matches tell (bends {bent:.1f}, contradictions {apart:.1f}; 1 is noise)"
        )
    return tuple(warnings)


def _joined(views: int, counts: Mapping[tuple[int, int], int]) -> int:
    """Into how many groups of views matches join them."""
    pairs = [pair for pair, count in counts.items() if count >= LEAST_MATCHES]
    ends = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return int(components(views, *ends).max()) + 1


def swayed(rig: Rig, matches: Matches) -> tuple[float, float]:
    """Signs of a body that does not stand still, in units of what noise makes: 1 is none.

    Cameras take up how a body shifts and leans as a whole. How it bends besides, sideways in each
    photo by a parabola of the height, is solved for beside them, once. Photos on both sides of one
    then place a point differently, by more than matches are off across their lines.

    Returns:
        How many times the squares that chance would take away go away with the bends; and the
        typical contradiction of two pairs. Both are 0 where too few points are seen by two pairs.
    """
    told, (this, other) = met(rig, matches), matches.twice.T
    if len(this) < _LEAST_TWICE:
        return 0.0, 0.0
    apart = told.out_m[this] - told.out_m[other]
    noise_px, apart_m = (_typical(each) for each in (told.off_px, apart))
    by_noise = noise_px * np.sqrt(2) * np.hypot(told.out_by_px[this], told.out_by_px[other])
    rows = MatchRows(matches, noise_px, apart_m).rows(rig)
    up, count = upright_line(rig), 6 * len(rig)
    height = told.points @ up
    low, high = np.percentile(height, [1, 99])
    level = np.clip(2 * (height - low) / (high - low) - 1, -1, 1)
    bent = 1.5 * np.concatenate([level, level[this]]) ** 2 - 0.5
    sideways = np.cross(up, rig.rotations[:, 2])
    sideways /= np.linalg.norm(sideways, axis=1, keepdims=True)
    by_pose = rows.jacobian.toarray()[:, :count]
    by_shift = by_pose.reshape(-1, len(rig), 6)[:, :, 3:]
    by_bend = np.einsum("mci,cij,cj->mc", by_shift, rig.rotations, sideways) * bent[:, None]
    both = np.concatenate([by_pose, by_bend], axis=1)
    gone = _explained(rows, both) - _explained(rows, by_pose)
    by_chance = float(rows.weights @ rows.residuals**2) * len(rig) / len(rows.residuals)
    return gone / by_chance, _typical(apart / by_noise)


def missed_m(rig: Rig, matches: Matches) -> float:
    """Median distance of held-out matches from their epipolar lines, metres at the subject.

    NaN where they are too few.
    """
    judged = matches.of(matches.held_out)
    if len(judged) < LEAST_MATCHES:
        return np.nan
    off_px = np.abs(met(rig, judged).off_px)
    return float(np.median(off_px * landmark_spans(rig)[judged.views[:, 1]]))


def check_sure(
    sds_deg: Mapping[str, float], off_m: float, left_out: Sequence[str]
) -> tuple[str, ...]:
    """A warning of cameras that are weak.

    Args:
        sds_deg: Standard deviations of the cameras' turns, by photo.
        off_m: ``missed_m``.
        left_out: What a refusal says of photos that are not among them.

    Raises:
        MethodError: outlines and matches leave the cameras open.
    """
    median_deg = float(np.median(list(sds_deg.values())))
    if median_deg > _MOST_SD_DEG or (median_deg > _WEAK_SD_DEG and off_m > _WEAK_OFF_M):
        raise MethodError(
            "the photos do not tell their cameras",
            expected=f"turns that are sure to {_MOST_SD_DEG:g} degree (standard deviation), or to "
            f"{_WEAK_SD_DEG:g} where matches miss by {1e3 * _WEAK_OFF_M:.1f} mm",
            got="; ".join((f"{median_deg:.1f} degrees, {1e3 * off_m:.1f} mm", *left_out)),
            hint="Take eight photos or more, in patterned clothes; check the masks",
        )
    weak = sorted(name for name, sd_deg in sds_deg.items() if sd_deg > _WEAK_SD_DEG)
    if not weak:
        return ()
    sd_deg = max(sds_deg.values())
    return (f"cameras are weak, sure to {sd_deg:.1f} degrees only: {', '.join(weak)}",)


def _typical(values: Floats) -> float:
    """The standard deviation that a median of sizes stands for."""
    return _TYPICAL * float(np.median(np.abs(values)))


def _explained(rows: Rows, by: Floats) -> float:
    """The weighted squares that unknowns take away, by (M, K) of what residuals change."""
    weighted = by * rows.weights[:, None]
    matrix, slope = weighted.T @ by, weighted.T @ rows.residuals
    matrix += np.diag(1e-6 * matrix.diagonal() + 1e-12)
    return float(slope @ np.linalg.solve(matrix, slope))


def spreads(found: Solved) -> tuple[Floats, float]:
    """(C, 6, 6) covariances of cameras, relative to all of them, and the factor's deviation.

    They follow from the normal equations, without the ways in which all cameras can move together.
    """
    rig = found.rig
    count = 6 * len(rig) + (rig.factor_sd > 0)
    unit = np.ones(count)
    unit[: 6 * len(rig)] = np.tile([1.0] * 3 + [float(rig.shifts[:, 2].mean())] * 3, len(rig))
    values, vectors = np.linalg.eigh(found.matrix[:count, :count] * np.outer(unit, unit))
    kept = np.arange(count) >= _GAUGE
    vectors = vectors[:, kept] * unit[:, None]
    whole = (vectors / np.maximum(values[kept], 1e-12)) @ vectors.T
    own = [whole[6 * v : 6 * v + 6, 6 * v : 6 * v + 6] for v in range(len(rig))]
    return np.stack(own), float(np.sqrt(whole[-1, -1])) if rig.factor_sd > 0 else 0.0
