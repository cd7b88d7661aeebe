"""Tasks that are interrupted say in a line what is finished, and what to type."""

import signal

import pytest
from catalogues import catalogue
from program import ended

from brushexp.runs.closing import how_to_go_on
from brushexp.strokes.storage import save_catalogue
from brushexp.system.run_files import CHECKPOINT, METRICS_FILE, recorded


@pytest.mark.parametrize(("files", "task", "said"), [
    ([], "export", "nothing is finished; to begin anew, type the same and: output=my run"),
    (["run.log", "a", "b"], "export", "my run has a, b; to begin anew, type the same and: output=my run"),
    (["a", "b", "c", "d", "e", "painting.png"], "x", "my run has painting.png, a, b, c and 2 more; to begin anew"),
    ([METRICS_FILE], "paint", f"my run has {METRICS_FILE}; to begin anew, type the same and: output=my run over"),
    (["a", CHECKPOINT], "paint", "continue with: brushexp resume=my run"),
    ([CHECKPOINT], "train", "continue with: brushexp task=train resume=my run"),
])  # fmt: skip
def test_what_is_finished_is_named_and_what_to_type(files, task, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (folder := tmp_path / "my run" / ".hydra").mkdir(parents=True)
    with recorded(folder.parent):
        for name in files:
            (folder.parent / name).touch()
    assert how_to_go_on(folder.parent, task).replace("'", "").startswith(said)


def test_an_export_says_what_it_has_and_is_begun_anew(tmp_path):
    save_catalogue(tmp_path / "some.h5", catalogue())
    words = ["task=export", "catalogue=some.h5", "to=[svg,json]", "output=x"]
    code, output = ended(tmp_path, *words, kill=("strokes.svg", 1, True), sent=signal.SIGTERM)
    assert code == 128 + signal.SIGTERM
    assert output == "note: interrupted; x has strokes.svg; to begin anew, type the same and: output=x\n"
    code, output = ended(tmp_path, *words)
    assert code == 0, output
    assert (tmp_path / "x" / "strokes.json").is_file()
