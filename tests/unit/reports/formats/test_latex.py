"""The LaTeX compiles: by LaTeX itself where it is installed, by a strict reader everywhere."""

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.core.protocols import Part
from harness.run.store import RunStore
from reports.formats.latex import escape, to_latex
from reports.tables.cost import cost_table
from reports.tables.geometry import geometry_table
from reports.tables.selection import Asked

RECORDS = RunStore(Path(__file__).parents[3] / "golden" / "run").records()
NASTY = r"50% & $5_000 #1 {a}\b ~^ <x> |y| " + '"q" [z] * Uğur × ± ≥ 漢 --flag –'


def spread(values):
    return min(values), max(values)


def nasty_records():
    """Every text that a third party can put into a table is as bad as it can be."""
    part = Part(role=NASTY, name=NASTY, licence=NASTY)
    for record in RECORDS:
        method = replace(record.method, title=f"[{NASTY}", parts=(part,))
        stages = tuple(replace(stage, name=f"{NASTY} {stage.name}") for stage in record.stages)
        yield replace(
            record, method=method, stages=stages, dataset=NASTY, reason=record.reason and NASTY
        )


TABLES = {
    "geometry": geometry_table(RECORDS),
    "published": geometry_table(RECORDS, Asked(published=True, interval=spread)),
    "complete": geometry_table(RECORDS, Asked(methods=["hull8"])),
    "cost": cost_table(RECORDS, Asked(published=True, interval=spread)),
    "nasty": geometry_table(list(nasty_records()), Asked(interval=spread)),
    "nasty cost": cost_table(list(nasty_records())),
}


def check_balanced(source):
    """Braces and environments close in order; dollar signs come in pairs; all is ASCII."""
    assert source.isascii()
    plain = re.sub(r"\\[{}$&#_%\\~^]", "", re.sub(r"(?<!\\)%.*", "", source))
    depth = 0
    for character in plain:
        depth += {"{": 1, "}": -1}.get(character, 0)
        assert depth >= 0
    assert depth == 0
    assert plain.count("$") % 2 == 0
    assert not set("~#") & set(plain)
    stack = []
    for kind, name in re.findall(r"\\(begin|end)\{(\w+)\}", plain):
        if kind == "begin":
            stack.append(name)
        else:
            assert stack.pop() == name
    assert not stack


def body_rows(source):
    body = source.split(r"\toprule")[1].split(r"\bottomrule")[0]
    return [line.strip() for line in body.splitlines() if line.strip().endswith(r"\\")]


@pytest.mark.parametrize("name", TABLES)
def test_every_row_fills_the_columns(name):
    source = to_latex(TABLES[name])
    check_balanced(source)
    columns = len(re.search(r"\\begin\{tabular\}\{(\w+)\}", source)[1])
    rows = body_rows(source)
    assert len(rows) > 1
    for row in rows:
        spanned = re.search(r"\\multicolumn\{(\d+)\}", row)
        cells = len(re.split(r"(?<!\\)&", row))
        assert (int(spanned[1]) if spanned else cells) == columns
        # LaTeX would take these for an argument of the line break above.
        assert not row.startswith(("[", "*"))


@pytest.mark.parametrize(
    "broken", ["{", "}", "$x", r"\begin{table}", r"\begin{a}\end{b}", "#", "é"]
)
def test_the_reader_of_this_test_sees_what_would_not_compile(broken):
    with pytest.raises((AssertionError, IndexError)):
        check_balanced(to_latex(TABLES["geometry"]).replace("Visual hull", broken))


@given(st.text())
def test_any_text_can_be_escaped(text):
    check_balanced(escape(text))


@pytest.mark.parametrize(
    ("text", "source"),
    [
        ("a_b", r"a\_b"),
        ("50 %", r"50 \%"),
        (r"C:\x", r"C:\textbackslash{}x"),
        ("Uğur", r"U\u{g}ur"),
        ("Marí", r"Mar\'{i}"),
        ("--run", "-{}-run"),
        ("1–2", "1--2"),
        ("two\nlines", "two lines"),
        ("漢", "[U+6F22]"),
    ],
)
def test_escaped_text_prints_as_written(text, source):
    assert escape(text) == source


def test_arrows_units_and_bold():
    source = to_latex(TABLES["geometry"])
    titles, units = body_rows(source)[:2]
    assert titles.startswith("Method & n/N & Chamfer & P2S Acc. & P2S Comp. & Normal")
    assert re.findall(r"\((\w+)\) \$\\downarrow\$", units) == ["mm", "mm", "mm", "deg"]
    assert source.count("18.40") == 2
    assert source.count(r"\textbf{18.40}") == 1
    assert r"\textbf{0.00}" not in source
    assert r"\downarrow" not in to_latex(TABLES["cost"])


def test_the_count_stands_where_a_row_is_incomplete_and_only_there():
    assert "2/3" in to_latex(TABLES["geometry"])
    assert "n/N" not in to_latex(TABLES["complete"])


@pytest.mark.nightly
@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="pdflatex is not installed")
def test_latex_accepts_all_tables(tmp_path):
    body = "\n".join(to_latex(table) for table in TABLES.values())
    document = (
        r"\documentclass{article}\usepackage{booktabs}\begin{document}"
        f"\n{body}\n"
        r"\end{document}"
    )
    (tmp_path / "tables.tex").write_text(document, encoding="ascii")
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "tables.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
