"""``harness capture``: photos of real people come in, captures go out."""

from dataclasses import replace as replaced
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.display import print_json, shown_progress
from harness.cli.options import Json, Timeout, WorkspacePath, limit_s
from harness.cli.verb_list import verb_group
from harness.core.errors import HarnessError
from harness.core.typed_json import to_json
from harness.data.camera_files import camera_file
from harness.data.camera_sets import CAMERA_SETS, unpacked_set
from harness.photos.exporting import FORMATS, ExportRequest, export_capture, named_capture
from harness.photos.request import AUTO, Imported, ImportRequest, import_capture
from harness.run.progress import Progress
from harness.run.sources import CAPTURES, IMPORTED, imported_subjects, name_for
from harness.run.workspace import Workspace

app = verb_group("capture")

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder with the photos.")]
Cameras = Annotated[
    Path | None,
    typer.Option(
        "--cameras",
        metavar="FILE",
        help="Camera file: nerfstudio's transforms.json, COLMAP's folder (text or binary), a "
        "published camera_parameters.json, or a capture.json; or the photo set that DIR is of: "
        f"{', '.join(CAMERA_SETS)}. Default: looked for in DIR; without one, cameras are estimated "
        "from the photos.",
    ),
]
Frame = Annotated[
    int | None,
    typer.Option("--frame", metavar="N", help="Which frame of a photo set. Default: the first."),
]
Field = Annotated[
    float,
    typer.Option(
        "--fov",
        metavar="DEGREES",
        help="Field of view along the longer side, of photos without a camera file. Default: about "
        "as their files tell; if they do not, it is found with the cameras.",
    ),
]
Refine = Annotated[
    bool,
    typer.Option(
        "--refine-cameras",
        help="Correct cameras that are a few pixels or degrees off, by outlines and photos.",
    ),
]
Masks = Annotated[
    Path | None,
    typer.Option(
        "--masks",
        metavar="DIR",
        help="Folder with a mask for each photo, white on black. Default: the photos' alpha; "
        "where there is none, masks are made.",
    ),
]
MasksBy = Annotated[
    str,
    typer.Option(
        "--masks-by",
        metavar="NAME",
        help="Imported network that makes masks which are missing; see 'harness parts list'. "
        "Default: MediaPipe.",
    ),
]
MaskOrientation = Annotated[
    str,
    typer.Option(
        "--mask-orientation",
        metavar="WHICH",
        help="Whether masks of photos that their files turn are of the photo as stored or as shown "
        "by viewers: stored or shown. By default size and agreement tell.",
    ),
]
Name = Annotated[
    str, typer.Option("--name", metavar="NAME", help="Name of the capture. Default: DIR's name.")
]
Up = Annotated[
    str,
    typer.Option(
        "--up",
        metavar="AXIS",
        help="Which way is up in the camera file, such as +z, -y or 0,0,1. By default the cameras "
        "tell, which are held level.",
    ),
]
Facing = Annotated[
    str,
    typer.Option(
        "--facing",
        metavar="AXIS",
        help="Where the person faces in the camera file, such as -y; or a photo from the front. By "
        "default landmarks in the photos tell.",
    ),
]
Height = Annotated[
    float,
    typer.Option(
        "--height", metavar="METRES", help="How high the person is as they stand in the photos."
    ),
]
Scale = Annotated[
    str,
    typer.Option(
        "--scale",
        metavar="METRES",
        help="Metres per unit of the camera file; auto estimates it from a mean height.",
    ),
]
Origin = Annotated[
    str,
    typer.Option(
        "--origin",
        metavar="WHERE",
        help="Where the origin goes: subject is the person's middle, file leaves it as it is.",
    ),
]
Longest = Annotated[
    int,
    typer.Option("--longest", metavar="PIXELS", help="Photos with a longer side are made smaller."),
]
Accept = Annotated[
    bool, typer.Option("--accept", help="Import photos that contradict their cameras, too.")
]
Incomplete = Annotated[
    bool,
    typer.Option(
        "--incomplete", help="Import what is there where photos or masks are missing or empty."
    ),
]
Replace = Annotated[
    bool, typer.Option("--replace", help="Replace a capture of that name, of other photos, too.")
]


@app.command("import")
def import_photos(
    folder: Folder,
    cameras: Cameras = None,
    frame: Frame = None,
    masks: Masks = None,
    masks_by: MasksBy = "",
    mask_orientation: MaskOrientation = AUTO,
    name: Name = "",
    up: Up = AUTO,
    facing: Facing = AUTO,
    field: Field = 0.0,
    refine: Refine = False,
    height: Height = 0.0,
    scale: Scale = "",
    origin: Origin = "subject",
    longest: Longest = 1920,
    accept: Accept = False,
    incomplete: Incomplete = False,
    replace: Replace = False,
    timeout: Timeout = 3600.0,
    workspace: WorkspacePath = None,
    as_json: Json = False,
) -> None:
    """Import photos as a capture, with cameras of another program or with none.

    Without cameras, five photos or more from all around a person who stands still are enough: their
    cameras are found from them, with --height. Lens distortion is undone. Photos are turned
    upright, and only the person is kept of them. It is said where masks came from, and how up,
    front and scale were found.
    """
    place, subject = Workspace.default(workspace), name or name_for(folder)
    request = ImportRequest(
        photos=str(folder.resolve()),
        cameras="" if str(cameras) in CAMERA_SETS else camera_file(folder, cameras),
        masks="" if masks is None else str(masks.resolve()),
        masks_by=masks_by,
        directory=str(place.capture(CAPTURES, subject, IMPORTED)),
        dataset=CAPTURES,
        subject=subject,
        recipe=IMPORTED,
        up=up,
        facing=facing,
        height_m=height,
        scale=scale,
        origin=origin,
        longest_px=longest,
        accept=accept,
        replace=replace,
        incomplete=incomplete,
        mask_orientation=mask_orientation,
        field_deg=field,
        refine=refine,
    )
    with shown_progress(quiet=as_json) as progress:
        made = _made(request, str(cameras), frame, progress, limit_s(timeout))
    if as_json:
        print_json({"name": subject, **to_json(made)})
        return
    _show(subject, made)


def _made(
    request: ImportRequest, cameras: str, frame: int | None, progress: Progress, limit: float | None
) -> Imported:
    """The import itself, of a photo set's own cameras if it is named."""
    if cameras not in CAMERA_SETS:
        if frame is not None:
            sets = ", ".join(CAMERA_SETS)
            raise HarnessError("--frame is of photo sets", expected=f"--cameras with one of {sets}")
        return import_capture(request, progress, limit)
    # These sets are in metres.
    scale = request.scale or ("" if request.height_m else "1")
    folder, incomplete = Path(request.photos), request.incomplete
    with unpacked_set(cameras, folder, frame, incomplete=incomplete) as found:
        own = replaced(request, photos=str(found.folder), cameras=str(found.cameras), scale=scale)
        made = import_capture(own, progress, limit)
    return replaced(made, notes=(*found.notes, *made.notes))


def _show(subject: str, made: Imported) -> None:
    print(f"{subject}: {made.views} photos in {made.directory}")
    for line in made.notes:
        print(f"  {line}")
    for line in made.warnings:
        print(f"  warning: {line}")
    print(f"Next: harness reconstruct {subject} --method hull,mexecon+")


@app.command("list")
def list_captures(workspace: WorkspacePath = None, as_json: Json = False) -> None:
    """List the captures that were imported."""
    names = imported_subjects(Workspace.default(workspace))
    if as_json:
        print_json(list(names))
        return
    for subject in names:
        print(subject)


@app.command("export")
def export(
    capture: Annotated[
        str,
        typer.Argument(
            metavar="CAPTURE", help="Name of an imported capture, or a folder with a capture.json."
        ),
    ],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to be made.")],
    cameras: Annotated[
        str, typer.Option("--cameras", metavar="FORMAT", help=f"One of {', '.join(FORMATS)}.")
    ] = FORMATS[0],
    no_alpha: Annotated[
        bool,
        typer.Option(
            "--no-alpha", help="Put the person before plain grey instead of keeping alpha."
        ),
    ] = False,
    masks: Annotated[bool, typer.Option("--masks", help="Write masks as files, too.")] = False,
    workspace: WorkspacePath = None,
) -> None:
    """Export a capture as plain photos with a camera file, for other programs."""
    found = named_capture(Workspace.default(workspace), capture)
    request = ExportRequest(folder, cameras, alpha=not no_alpha, masks=masks)
    names = export_capture(found, request)
    print(f"{len(names)} photos and their cameras ({cameras}) in {folder}")
