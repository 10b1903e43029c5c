"""What a table says of people who were seen in training."""

from dataclasses import replace
from pathlib import Path

from harness.core.records import Record
from reports.tables.selection import select

FOLDER = Path(__file__).parents[3] / "golden" / "run"


def records(trained_on, identity=""):
    paths = sorted(FOLDER.glob("hull8/*/record.json"))
    found = [Record.load(path, *path.parts[-3:-1]) for path in paths]
    return [
        replace(each, identity=identity, method=replace(each.method, trained_on=trained_on))
        for each in found
    ]


def seen(of):
    (group,) = select(of).groups
    return [note for note in group.notes if note.startswith("Trained on")]


def test_a_table_says_which_subjects_a_method_was_trained_on(tmp_path):
    first, *_ = known = records(())
    assert seen(known) == []
    count = sum(each.status == "ok" for each in known)
    name = f"{first.dataset}/{first.subject}"
    assert seen(records((name,))) == [
        f"Trained on {name}: 1 of {count} subjects were seen in training ({first.subject})"
    ]
    assert f"{count} of {count} subjects" in seen(records((first.dataset,)))[0]
    assert f"{count} of {count} subjects" in seen(records(("person 3",), "person 3"))[0]
    assert f"0 of {count} subjects" in seen(records(("person 4",), "person 3"))[0]


def test_ranges_and_people_of_other_datasets_count(tmp_path):
    """Of a range, those in it; of people who are in another dataset, those who were seen there."""
    first, *_ = known = records(())
    count, home = sum(each.status == "ok" for each in known), first.dataset
    one = (f"{home}/{first.subject}..{first.subject}", f"{home}/z00001..z00009")
    assert seen(records(one)) == [
        f"Trained on subjects of {home}: 1 of {count} subjects were seen in training "
        f"({first.subject})"
    ]
    assert f"{count} of {count} subjects" in seen(records(("thuman20",), "thuman20/0004"))[0]
    span = ("thuman20/0000..0005",)
    assert f"{count} of {count} subjects" in seen(records(span, "thuman20/0004"))[0]
    for other in ("thuman20/0006", "thuman20/00004", "thuman21/0004", "0004"):
        assert f"0 of {count} subjects" in seen(records(span, other))[0]


def test_a_record_holds_both_and_one_without_them_stays_as_it_was(tmp_path):
    said, plain = records(("thuman21",), "person 3")[0], records(())[0]
    for record in (said, plain):
        place = tmp_path / record.method_name / record.subject
        place.mkdir(parents=True, exist_ok=True)
        record.save(place / "record.json")
        assert Record.load(place / "record.json", *place.parts[-2:]) == record
    assert "identity" not in plain.to_dict()
    # One that was written before a method could say why it needs perspective.
    document = plain.to_dict()
    del document["method"]["needs_perspective"]
    assert Record.from_document(document, "a record") == plain
