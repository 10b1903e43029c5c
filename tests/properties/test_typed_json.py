"""Records and results go to JSON and back without a change, and nothing else is read."""

from __future__ import annotations

import json
from dataclasses import fields, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.core.artifacts import StageCost
from harness.core.errors import DataError
from harness.core.protocols import Deviation, MethodInfo, Part, Privilege
from harness.core.records import (
    AngularErrors,
    BodyErrors,
    CaptureStamp,
    Diagnostics,
    Environment,
    MetricValue,
    NormalMapErrors,
    ProtocolStamp,
    Record,
    RegionErrors,
    Scores,
)
from harness.core.settings import MetricProtocol
from harness.core.typed_json import from_json, to_json
from harness.run.cell_job import CellResult

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
TEXTS = st.text(max_size=8)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | NUMBERS | TEXTS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3),
    max_leaves=5,
)
DETAILS = st.dictionaries(TEXTS, JSON, max_size=3)
st.register_type_strategy(float, NUMBERS)
st.register_type_strategy(str, TEXTS)
METRICS = st.dictionaries(TEXTS, st.from_type(MetricValue), max_size=3)
SCORES = st.builds(
    Scores,
    metrics=METRICS,
    regions=st.dictionaries(TEXTS, st.from_type(RegionErrors), max_size=3),
    normal_maps=st.lists(st.from_type(NormalMapErrors), max_size=2).map(tuple),
    warnings=st.lists(TEXTS, max_size=2).map(tuple),
    diagnostics=st.none() | st.from_type(Diagnostics),
)
METHODS = st.builds(
    MethodInfo,
    views=st.none() | st.lists(st.integers(0, 9), max_size=3).map(tuple),
    parts=st.lists(st.from_type(Part), max_size=2).map(tuple),
    privileges=st.lists(st.sampled_from(Privilege), max_size=3).map(tuple),
    parameters=st.dictionaries(TEXTS, DETAILS, max_size=2),
    deviations=st.lists(st.from_type(Deviation), max_size=2).map(tuple),
)
STAGES = st.lists(st.from_type(StageCost), max_size=2).map(tuple)
FILES = st.dictionaries(TEXTS, TEXTS, max_size=2)


@st.composite
def records(draw: st.DrawFn) -> Record:
    scores = draw(SCORES)
    return Record(
        key=draw(TEXTS),
        method=draw(METHODS),
        dataset=draw(TEXTS),
        subject=draw(TEXTS),
        recipe=draw(TEXTS),
        protocol=draw(st.from_type(MetricProtocol).map(ProtocolStamp.of)),
        capture=draw(st.from_type(CaptureStamp)),
        seed=draw(st.integers()),
        status=draw(st.sampled_from(("ok", "failed", "missing"))),
        reason=draw(TEXTS),
        metrics=scores.metrics,
        regions=scores.regions,
        normal_maps=scores.normal_maps,
        warnings=scores.warnings,
        diagnostics=scores.diagnostics,
        stages=draw(STAGES),
        details=draw(DETAILS),
        environment=draw(st.none() | st.from_type(Environment)),
        inputs=draw(DETAILS),
        files=draw(FILES),
    )


def there_and_back(value: object) -> object:
    text = json.dumps(to_json(value), allow_nan=False)
    return from_json(type(value), json.loads(text), "text", "a value")


@given(records())
def test_a_record_is_read_as_it_was_written(record: Record) -> None:
    assert there_and_back(record) == record


@given(
    st.builds(
        CellResult,
        status=st.sampled_from(("ok", "failed", "missing", "changed")),
        scores=SCORES,
        stages=STAGES,
        details=DETAILS,
        files=FILES,
        environment=st.none() | st.from_type(Environment),
    )
)
def test_a_workers_answer_arrives_as_it_was_sent(result: CellResult) -> None:
    written = json.loads(json.dumps(to_json(result)))
    assert from_json(CellResult, written, "the answer", "one") == result


@given(st.from_type(BodyErrors))
def test_errors_of_a_body_arrive_under_their_metric_ids(errors: BodyErrors) -> None:
    assert there_and_back(errors) == errors
    assert BodyErrors(**errors.by_id()) == errors


@given(records(), st.data())
def test_a_field_too_few_or_too_many_is_named(record: Record, data: st.DataObject) -> None:
    document = to_json(record)
    name = data.draw(st.sampled_from([field.name for field in fields(Record)]))
    del document[name]
    with pytest.raises(DataError, match=f"r.json is not a record .*'{name}'; got none"):
        from_json(Record, document, "r.json", "a record")
    with pytest.raises(DataError, match="no such field at 'surprise'"):
        from_json(Record, {**to_json(record), "surprise": 1}, "r.json", "a record")


ANGLES = to_json(AngularErrors(1.0, 2.0, 0.5, 0.75, 1.0, 4))
MAP = {
    "view": 0,
    "yaw_deg": 0.0,
    "side": "near",
    "clothed": None,
    "whole": {"estimate": ANGLES, "body": ANGLES},
    "folds": None,
}
PROTOCOL = to_json(MetricProtocol("exact", 1, 10, "stratified", "point-to-surface"))


@pytest.mark.parametrize(
    ("kind", "document", "message"),
    [
        (MetricValue, [], "expected an object; got list"),
        (NormalMapErrors, {**MAP, "view": 0.5}, "a whole number at 'view'; got float"),
        (NormalMapErrors, {**MAP, "view": True}, "a whole number at 'view'; got bool"),
        (NormalMapErrors, {**MAP, "yaw_deg": True}, "a number at 'yaw_deg'; got bool"),
        (NormalMapErrors, {**MAP, "whole": None}, "an object at 'whole'; got NoneType"),
        (NormalMapErrors, {**MAP, "side": "left"}, "an unknown side .*near, far; got left"),
        (MetricProtocol, {**PROTOCOL, "sampling": 3}, "an unknown sampling .*independent"),
        (
            CaptureStamp,
            {"key": "", "views": 8, "warnings": "none"},
            "an array at 'warnings'; got str",
        ),
        (CaptureStamp, {"key": None, "views": 8, "warnings": []}, "text at 'key'; got NoneType"),
        (CaptureStamp, {"key": "", "views": 8, "warnings": [1]}, "text at 'warnings.0'; got int"),
    ],
)
def test_a_value_of_another_type_is_refused_with_its_place(
    kind: type, document: object, message: str
) -> None:
    with pytest.raises(DataError, match=message):
        from_json(kind, document, "r.json", "a value")


def test_a_whole_number_where_a_number_may_stand_stays_as_it_was_written() -> None:
    found = from_json(
        MetricValue,
        {"value": 0, "unit": "mm", "n": 3, "standard_error": 0.5, "floor": 0.0},
        "r.json",
        "a value",
    )
    assert json.dumps(to_json(found)).startswith('{"value": 0, ')
    assert found == replace(found, value=0.0)
