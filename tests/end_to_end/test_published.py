"""The authors' own results are shown anywhere: no run, no data, no workspace."""

import json
import subprocess
import sys


def report(place, *arguments):
    command = [sys.executable, "-m", "harness.cli.main", "report", *arguments]
    return subprocess.run(
        command, cwd=place, capture_output=True, text=True, timeout=120, check=False
    )


def test_published_results_need_no_run(tmp_path):
    done = report(tmp_path, "--table", "published", "--paired", "--json")
    assert done.returncode == 0, done.stderr
    rows = {row["method"]: row["metrics"] for row in json.loads(done.stdout)["rows"]}
    assert round(rows["mexecon8"]["chamfer"]["mean"], 2) == -0.31
    written = report(tmp_path, "--table", "published", "--format", "latex", "-o", "table.tex")
    assert written.returncode == 0, written.stderr
    assert "8-view VGGT" in (tmp_path / "table.tex").read_text()
    assert [path.name for path in tmp_path.iterdir()] == ["table.tex"]


def test_a_table_of_a_run_still_needs_one(tmp_path):
    refused = report(tmp_path, "--table", "paired", "--paired")
    assert refused.returncode == 2
    assert "no run below" in refused.stderr
