"""Croissant metadata of generated datasets: what is in the files, for programs that load data.

Croissant is a vocabulary of MLCommons on top of schema.org, here in version 1.0. The description
lies beside the folder ``model`` of the dataset, and names its files relative to itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date

from harness import __version__
from harness.core.errors import HarnessError
from harness.data.avatars import AVATARS_VERSION
from harness.data.manifest import Dataset

__all__ = ["CROISSANT_FILE", "Publication", "croissant_document"]

#: What the description is called, beside the folder ``model``.
CROISSANT_FILE = "croissant.json"
_CONFORMS_TO = "http://mlcommons.org/croissant/1.0"
_LICENCES = {"CC0-1.0": "https://creativecommons.org/publicdomain/zero/1.0/"}
#: Short names for the vocabulary's terms, as the specification gives them.
_CONTEXT: Mapping[str, object] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileProperty": "cr:fileProperty",
    "fileObject": "cr:fileObject",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
#: The files of every subject: id, pattern, type, what they are.
_FILES = (
    ("scans", "*.obj", "model/obj", "Clothed surface in metres, +Y up, facing +Z, with texture"),
    ("materials", "material0.mtl", "model/mtl", "Names the texture of a scan"),
    ("textures", "material0.jpeg", "image/jpeg", "Texture of a scan"),
    ("bodies", "body.npz", "application/zip", "True body under the clothes, its pose and shape"),
    ("labels", "labels.npz", "application/zip", "Region of every triangle: skin, hair, garments"),
    ("recipes", "avatar.json", "application/json", "How a subject was made, what was measured"),
    ("licences", "LICENSE.txt", "text/plain", "Licence of a subject's files"),
)
#: Numbers of ``avatar.json``: field, type, where.
_MEASURED = (
    ("generator_version", "sc:Integer", "$.version", "Version of the program's generator"),
    ("vertices", "sc:Integer", "$.measured.vertices", "Vertices of the scan"),
    ("faces", "sc:Integer", "$.measured.faces", "Triangles of the scan"),
    ("height_m", "sc:Float", "$.measured.height_m", "Height of the clothed person in metres"),
    ("watertight", "sc:Boolean", "$.measured.watertight", "Whether the scan is watertight"),
)


@dataclass(frozen=True, slots=True)
class Publication:
    """What the program cannot know of a copy of a dataset.

    Attributes:
        url: Where this copy is published.
        published: When.
    """

    url: str
    published: date


def croissant_document(name: str, dataset: Dataset, publication: Publication) -> dict[str, object]:
    """The description of a generated dataset, as JSON-LD.

    Args:
        name: The dataset's name in the manifest.
        dataset: What the manifest says of it.
        publication: Where and when it is published.

    Raises:
        HarnessError: scans that are not generated here, which others describe and may license.
    """
    if dataset.kind != "generated" or dataset.licence not in _LICENCES:
        raise HarnessError(
            f"the scans of dataset '{name}' are not made by this program, which therefore does not "
            "describe them",
            expected="a dataset of kind generated",
            got=f"kind {dataset.kind}, licence {dataset.licence}",
        )
    return {
        "@context": dict(_CONTEXT),
        "@type": "sc:Dataset",
        "name": name,
        "description": _description(dataset),
        "conformsTo": _CONFORMS_TO,
        "url": publication.url,
        "license": _LICENCES[dataset.licence],
        "version": f"{AVATARS_VERSION}.0.0",
        "datePublished": publication.published.isoformat(),
        "creator": {"@type": "Organization", "name": "the mexecon-harness authors"},
        "citeAs": f"mexecon-harness {__version__}, dataset {name}, generator {AVATARS_VERSION}",
        "keywords": ["3D reconstruction", "clothed humans", "generated", "benchmark"],
        "isLiveDataset": False,
        "rai:dataCollection": "Generated by a program from written and drawn recipes.",
        "rai:personalSensitiveInformation": "None: no person was photographed or scanned.",
        "distribution": [_file_set(*entry) for entry in _FILES],
        "recordSet": [_subjects(dataset), _measured()],
    }


def _description(dataset: Dataset) -> str:
    noise = (
        f" Surfaces have bumps of {dataset.scan_noise_mm:g} mm such as a scanner leaves."
        if dataset.scan_noise_mm
        else ""
    )
    return (
        f"{dataset.title}: {len(dataset.subjects)} generated people in draped clothes, each one "
        "watertight textured surface with region labels, and the true body underneath. "
        f"They show no real person.{noise}"
    )


def _file_set(name: str, pattern: str, kind: str, text: str) -> dict[str, object]:
    return {
        "@type": "cr:FileSet",
        "@id": name,
        "name": name,
        "description": text,
        "encodingFormat": kind,
        "includes": f"model/*/{pattern}",
    }


def _subjects(dataset: Dataset) -> dict[str, object]:
    """Every subject with what it wears and does, as far as the manifest says it."""
    columns = ("id", "clothing", "pose") if dataset.classes else ("id",)
    rows = [
        {"id": subject} | (dataset.classes[subject].model_dump() if dataset.classes else {})
        for subject in dataset.subjects
    ]
    return {
        "@type": "cr:RecordSet",
        "@id": "subjects",
        "name": "subjects",
        "description": "The subjects, in the order of tables.",
        "key": {"@id": "subjects/id"},
        "field": [_field(f"subjects/{column}", "sc:Text") for column in columns],
        "data": [{f"subjects/{name}": value for name, value in row.items()} for row in rows],
    }


def _measured() -> dict[str, object]:
    """What was measured on each subject, from its own file."""
    path = {
        "fileSet": {"@id": "recipes"},
        "extract": {"fileProperty": "fullpath"},
        "transform": {"regex": r"^(?:.*/)?([^/]+)/avatar\.json$"},
    }
    fields = [_field("measured/subject", "sc:Text", "Id of the subject", path)]
    for name, kind, place, text in _MEASURED:
        source = {"fileSet": {"@id": "recipes"}, "extract": {"jsonPath": place}}
        fields.append(_field(f"measured/{name}", kind, text, source))
    return {
        "@type": "cr:RecordSet",
        "@id": "measured",
        "name": "measured",
        "description": "What was measured on each subject.",
        "field": fields,
    }


def _field(
    name: str, kind: str, text: str = "", source: Mapping[str, object] | None = None
) -> dict[str, object]:
    found: dict[str, object] = {
        "@type": "cr:Field",
        "@id": name,
        "name": name.rpartition("/")[2],
        "dataType": kind,
    }
    if text:
        found["description"] = text
    return found | ({"source": source} if source else {})
