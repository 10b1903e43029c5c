"""What Blender's cloth solver is asked for is the same on the other side."""

import json
from pathlib import Path

from clothed_avatars.clothes.drape_job import ClothFabric, DrapeJob, GarmentJob
from harness.core.typed_json import from_json, to_json


def test_a_job_survives_the_way_to_its_process():
    inner = GarmentJob(Path("a/bottom.npz"), Path("a/bottom.npy"), ClothFabric(0.7, 0.04, 5))
    outer = GarmentJob(Path("a/top.npz"), Path("a/top.npy"), ClothFabric(4.0, -0.01, 14))
    job = DrapeJob(Path("a"), Path("a/body.npz"), (inner, outer))
    written = json.loads(json.dumps(to_json(job)))
    assert from_json(DrapeJob, written, "the job", "one") == job
