"""The page's files: complete without a script, the same each time, and never in place of others."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from statistics import fmean
from urllib.parse import unquote

import pytest

from harness.core.errors import HarnessError
from reports.page import folder as folder_module
from reports.page.document import failures_html
from reports.page.folder import MARK_FILE, page_folder
from reports.tables.geometry import geometry_table
from tests.unit.reports.page.pages import RECORDS, SHOWN, compact, write_page


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    return write_page(tmp_path_factory.mktemp("page") / "page").parent


class Reader(HTMLParser):
    """Text, links and open elements of a document."""

    def __init__(self, text):
        super().__init__()
        self.links, self.names, self.text, self.open = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.links += [found[key] for key in ("href", "src") if key in found]
        self.names += [found["id"]] if "id" in found else []
        if tag not in ("meta", "link", "img", "input", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def document(page):
    return Reader((page / "index.html").read_text(encoding="utf-8"))


def data_of(page):
    text = (page / "data.js").read_text(encoding="utf-8")
    return json.loads(text.removeprefix("HarnessPage.data = ").removesuffix(";\n"))


def files_of(folder):
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()
    }


def test_elements_are_closed_and_names_are_unique(page):
    found = document(page)

    assert found.open == []
    assert len(found.names) == len(set(found.names))


def test_every_link_leads_to_a_file_of_the_page_or_a_place_in_it(page):
    found = document(page)
    named = {f"#{name}" for name in found.names}
    others = [link for link in found.links if link not in named and not link.startswith("data:")]

    assert others
    assert [link for link in others if not (page / unquote(link)).is_file()] == []


def test_every_file_that_the_data_name_is_there(page):
    found = data_of(page)
    names = [s["file"] for subject in found["subjects"] for s in subject["surfaces"]]
    names += [subject[key] for subject in found["subjects"] for key in ("photos", "thumbnail")]
    names += [r["file"] for records in found["records"].values() for r in records.values()]

    assert len(names) == sum(map(len, SHOWN.values())) + 4 + len(RECORDS)
    assert [name for name in names if not (page / unquote(name)).is_file()] == []


def test_a_coarse_form_is_written_and_named_where_there_is_one(tmp_path):
    coarse = write_page(tmp_path / "page", coarse={"vggt": 2}).parent
    named = {
        (subject["id"], surface["method"]): surface["coarse"]
        for subject in data_of(coarse)["subjects"]
        for surface in subject["surfaces"]
    }
    text = (coarse / "coarse" / "surfaces" / "vggt" / "a01.js").read_text()

    assert {key for key, name in named.items() if name} == {("a01", "vggt"), ("a02", "vggt")}
    assert named["a01", "vggt"] == "coarse/surfaces/vggt/a01.js"
    assert text.startswith('HarnessPage.receive(["a01","vggt","coarse"], {"vertices":9,"faces":8,')
    assert {p.parent.name for p in coarse.glob("coarse/**/*.js")} == {"vggt"}


def test_the_records_behind_the_numbers_are_the_records(page):
    for record in RECORDS:
        path = page / "records" / record.method_name / f"{record.subject}.json"
        assert json.loads(path.read_text()) == json.loads(json.dumps(record.to_dict()))


def test_nothing_is_asked_of_a_network(page):
    texts = [p.read_text() for p in page.rglob("*") if p.suffix in (".html", ".css")]

    assert [
        found for text in texts for found in re.findall(r"(?:https?:)?//[\w.]+\.\w+", text)
    ] == []


def test_a_number_names_the_subjects_that_it_is_the_mean_of(page):
    table = geometry_table(RECORDS)
    rows = data_of(page)["tables"]["geometry"]["rows"]

    assert len(rows) == len(table.rows)
    for row, values in zip(table.rows, rows, strict=True):
        for column, cell in row.cells.items():
            assert values[column] == dict(cell.by_subject)
            assert fmean(values[column].values()) == cell.value


def test_failures_are_named_with_their_reasons(page):
    text = " ".join(document(page).text)

    for record in RECORDS:
        if record.status != "ok":
            assert record.reason in text


def test_subjects_without_a_record_are_named():
    records = [r for r in RECORDS if (r.method_name, r.subject) != ("hull8", "a02")]
    text = " ".join(Reader(failures_html(records, ["a01", "a02", "a03"])).text)

    assert "Visual hull, 8 views: 1 of 3 subjects (a02)" in text
    assert "Not run" not in failures_html(RECORDS, ["a01", "a02", "a03"])


def test_the_bundle_is_of_the_release_that_its_source_names():
    web = Path(folder_module.__file__).parent / "web"
    release = json.loads((web / "three" / "package.json").read_text())["devDependencies"]["three"]
    lock = json.loads((web / "three" / "package-lock.json").read_text())
    head = (web / "three.js").read_text()[:200]

    assert head.startswith(f"/* three.js {release}, MIT licence, see three.LICENSE.txt */")
    assert lock["packages"]["node_modules/three"]["version"] == release
    assert "The MIT License" in (web / "three.LICENSE.txt").read_text()


def test_texts_are_texts_and_no_markup(page):
    source = (page / "index.html").read_text()

    assert "<h1>golden &lt;run&gt;</h1>" in source
    assert "Squares &amp; records." in source


def test_the_same_content_gives_the_same_bytes(page, tmp_path):
    again = write_page(tmp_path / "other" / "place").parent

    assert files_of(again) == files_of(page)


def test_a_page_replaces_a_page_as_a_whole(tmp_path):
    directory = tmp_path / "page"
    write_page(directory)
    (directory / "records" / "old.json").write_text("{}")
    write_page(directory)

    assert not (directory / "records" / "old.json").exists()


def test_a_folder_with_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")

    with pytest.raises(HarnessError, match="is no page"), page_folder(tmp_path):
        pass
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


def test_a_page_that_fails_half_way_leaves_the_page_before(tmp_path):
    directory = tmp_path / "page"
    write_page(directory)
    before = files_of(directory)

    with pytest.raises(ZeroDivisionError), page_folder(directory) as folder:
        folder.add_surface("a01", "hull8", compact("hull8"))
        raise ZeroDivisionError
    assert files_of(directory) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["page"]


def test_an_empty_folder_may_become_a_page(tmp_path):
    assert (write_page(tmp_path).parent / MARK_FILE).is_file()
