"""One bad entry of a ladder is one bad row: whatever its file is, and whatever seed it was run with."""

import io
import json
import os
import shutil
import struct
import zipfile
from dataclasses import replace
from functools import partial

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.cli.lab import ladder
from mbsbench.harness.lab.bundle.archive import write_archive
from mbsbench.harness.lab.ladder import bundling
from mbsbench.harness.lab.ladder.closing import FILE, TRIAL
from mbsbench.harness.lab.ladder.instances import digest_submission, draw_instances
from mbsbench.harness.lab.ladder.submission import BlindWorker, Submission, run_submission
from mbsbench.harness.results import records
from mbsbench.tests.covering import every

from ..harness.lab.ladder.forgeries.bundles import members_of
from ..harness.lab.ladder.forgeries.forger import NAME
from ..harness.lab.ladder.forgeries.test_submissions import SHORT, TEXT

VALUE = "round 4711 of the beacon"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The digest of an honest submission, and its bundles by the values that it was run with."""
    place = tmp_path_factory.mktemp("made")
    file, paths = place / "honest.py", {}
    file.write_text(TEXT.format("nothing"))
    submission = Submission(NAME, "dt", str(file), digest_submission(file.read_bytes()))
    with BlindWorker() as blind:
        for k, value in enumerate((VALUE, "7", TRIAL)):
            folder = place / f"run{k}"
            run_submission(submission, value, folder, kinds=SHORT, repeats=1, blind=blind)
            bundling.write_bundle(folder, paths.setdefault(value, place / f"{k}.zip"))
    return submission.digest, paths


@pytest.fixture
def ranked(tmp_path, monkeypatch, capsys):
    """The rows of the files in a folder, by their names."""
    monkeypatch.setattr(ladder, "read_entry", lambda *a, **k: bundling.read_entry(*a, **k, kinds=SHORT))

    def run(**files):
        folder = tmp_path / "ladder"
        folder.mkdir()
        for name, write in files.items():
            write(folder / f"{name}.zip")
        code = main(["ladder", str(folder), "--json"])
        rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
        assert (folder / "index.html").stat().st_size > 0
        return code, {r["file"]: r for r in rows}, folder

    return run


def damaged(members, change, method=zipfile.ZIP_DEFLATED):
    """A bundle whose bytes are changed once it is written."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
        at = archive.infolist()[-1]
    content = bytearray(stream.getvalue())
    change(content, at)
    return bytes(content)


def encrypt(content, member):
    """Set the bit that says so, in the file and in its list, of the last member."""
    for mark, bit in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        at = content.rfind(mark) + bit
        content[at : at + 2] = struct.pack("<H", 1)


def spoil(content, member):
    """Other bytes in the middle of the last member's data."""
    at = member.header_offset + 30 + len(member.filename) + member.compress_size // 2
    content[at : at + 8] = bytes(255 - b for b in content[at : at + 8])


def unknown_method(content, member):
    for mark, bit in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        at = content.rfind(mark) + bit
        content[at : at + 2] = struct.pack("<H", 77)


def with_new_digests(members, **changed):
    out = {n: c for n, c in members.items() if n != "manifest-sha256.txt" and n != bundling.MANIFEST}
    out |= {name.replace("__", "."): content for name, content in changed.items()}
    return lambda path: write_archive(path, out.items())


BAD = {
    "encrypted": lambda m: lambda p: p.write_bytes(damaged(m, encrypt)),
    "damaged deflate": lambda m: lambda p: p.write_bytes(damaged(m, spoil)),
    "damaged lzma": lambda m: lambda p: p.write_bytes(damaged(m, spoil, zipfile.ZIP_LZMA)),
    "damaged bzip2": lambda m: lambda p: p.write_bytes(damaged(m, spoil, zipfile.ZIP_BZIP2)),
    "unknown method": lambda m: lambda p: p.write_bytes(damaged(m, unknown_method)),
    "cut short": lambda m: lambda p: p.write_bytes(damaged(m, lambda c, _: c.__delitem__(slice(len(c) // 2, None)))),
    "empty": lambda m: lambda p: p.write_bytes(b""),
    "suite.toml not UTF-8": lambda m: with_new_digests(m, suite__toml=b'submission = "\xff"'),
    "suite.toml of another kind": lambda m: with_new_digests(m, suite__toml=b"a = ["),
    "suite.toml without a digest": lambda m: with_new_digests(m, suite__toml=b'submission = "a"'),
    "a solver in mathematics": lambda m: with_new_digests(
        m, suite__toml=b'submission = "$\\\\bad{$"\ndigest = "1"\nseed = "1"'
    ),
    "records.json not UTF-8": lambda m: with_new_digests(m, records__json=b"[\xff]"),
    "records.json deep": lambda m: with_new_digests(m, records__json=b"[" * 10**5),
    "records of numbers": lambda m: with_new_digests(m, records__json=b"[1, 2]"),
    "one record with text for a number": lambda m: with_new_digests(m, records__json=b'[{"run_id": 1}]'),
    "a pipe": lambda m: os.mkfifo,
    "a folder": lambda m: lambda p: p.mkdir(),
    "a link to a device": lambda m: lambda p: p.symlink_to("/dev/zero"),
    "a link to nothing": lambda m: lambda p: p.symlink_to(p.with_name("none")),
    "too large": lambda m: lambda p: p.open("wb").truncate(2**31),
}


def check_bad_files(made, ranked, kinds):
    """Rank bad files beside a good one: each is removed with its reason in a line, the good one keeps its rank."""
    content = made[1]["7"].read_bytes()
    bad = {what: BAD[what](members_of(made[1]["7"])) for what in kinds}
    code, rows, _ = ranked(**bad, good=lambda p: p.write_bytes(content))
    assert code == 1 and rows["good.zip"]["rank"] == 1 and not rows["good.zip"]["removed"]
    assert len(rows) == len(bad) + 1
    for what in bad:
        row = rows[f"{what}.zip"]
        assert row["rank"] is None, what
        (first, *_) = row["removed"]
        assert first and "\n" not in first and "Traceback" not in first, (what, first)


@pytest.mark.sampled(0)
def test_bad_files_are_bad_rows(made, ranked):
    """Of all kinds at once."""
    check_bad_files(made, ranked, BAD)


@pytest.mark.parametrize("what", every(BAD, len(BAD)))
def test_a_bad_file_is_one_bad_row(made, ranked, what):
    """With its reason in a line; the honest one beside it keeps its rank."""
    check_bad_files(made, ranked, [what])


def closed(digests, value=VALUE):
    return lambda path: path.with_name(FILE).write_text(f"value = {json.dumps(value)}\nentries = {json.dumps(digests)}")


def test_only_the_published_value_and_digests_entered_before_it_are_ranked(made, ranked):
    """One may not draw until it suits: neither seeds nor submissions."""
    digest, paths = made
    names = {"right": VALUE, "chosen": "7", "tried": TRIAL}
    entered = {name: partial(shutil.copy, paths[value]) for name, value in names.items()}
    code, rows, folder = ranked(**entered, statement=closed([digest]))
    assert code == 1 and rows["right.zip"]["rank"] == 1 and rows["right.zip"]["trial"] is False
    assert "a seed of its own choice: '7'" in rows["chosen.zip"]["removed"][0]
    assert "a trial" in rows["tried.zip"]["removed"][0]
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert VALUE in page and "A trial: " not in page


def test_a_submission_changed_after_the_value_is_known_is_no_entry(made, ranked):
    """Its digest is another."""
    _, paths = made
    late = paths[VALUE].read_bytes()
    _, rows, _ = ranked(late=lambda p: p.write_bytes(late), statement=closed(["0" * 64]))
    assert "was not entered before the value was known" in rows["late.zip"]["removed"][0]


@pytest.mark.parametrize(
    "text",
    [
        "value = 1\nentries = []",
        'value = ""\nentries = []',
        'value = "a"',
        'value = "a"\nentries = ["b"]',
        f'value = "{TRIAL}"\nentries = []',
        'value = "a"\nentries = []\nmore = 1',
        "value =",
    ],
)
def test_a_wrong_statement_is_one_line(made, tmp_path, capsys, text):
    """Exit code 2; nothing is ranked without the rule that was meant."""
    (tmp_path / "a.zip").write_bytes(made[1]["7"].read_bytes())
    (tmp_path / FILE).write_text(text)
    assert main(["ladder", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert FILE in said and "Traceback" not in said and said.count("\n") <= 2


def test_the_value_moves_every_instance():
    """An entry cannot know them before it is published."""
    digest = digest_submission(b"a submission")
    one, other = draw_instances(digest, VALUE), draw_instances(digest, VALUE + "1")
    moved = ("rotation", "unit_length", "unit_mass", "unit_time", "renumber")
    assert all(x.parameters[name] != y.parameters[name] for x, y in zip(one, other, strict=True) for name in moved)
    mirrors = {x.parameters["mirror"] for k in range(40) for x in draw_instances(digest, f"{VALUE}{k}")}
    assert len(mirrors) > 2  # none among them


def test_unfenced_is_marked(made, ranked, capsys):
    """On the page, in the table and in JSON: these runs were not said to be fenced; and so is a trial."""
    content = made[1]["7"].read_bytes()
    _, rows, folder = ranked(one=lambda p: p.write_bytes(content))
    assert rows["one.zip"]["fenced"] is False
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert "not fenced" in page
    capsys.readouterr()
    main(["ladder", str(folder)])
    assert "not fenced" in capsys.readouterr().out


def test_a_bundle_that_differs_from_our_own_run_of_it_is_removed(made, tmp_path, monkeypatch, capsys):
    """``labels.toml`` says which bundle is ours; a cost that is half of what we found is no cost."""
    folder = tmp_path / "ladder"
    folder.mkdir()
    (folder / "ours.zip").write_bytes(made[1]["7"].read_bytes())
    files = members_of(made[1]["7"])
    changed = json.loads(files["records.json"])
    for record in changed:
        record["cpu_median_s"] = 0.1 * float(record["cpu_median_s"])
    entry = bundling.read_entry(folder / "ours.zip", SHORT)
    cheap = replace(entry, file="theirs.zip", records=tuple(records.parse_record_json(json.dumps(r)) for r in changed))
    (folder / "theirs.zip").write_bytes(made[1]["7"].read_bytes())
    read = {"ours.zip": entry, "theirs.zip": cheap}
    monkeypatch.setattr(ladder, "read_entry", lambda file, **_: read[file.name])
    (folder / ladder.LABEL_FILE).write_text('"ours.zip" = "re-run by us"\n')
    assert main(["ladder", str(folder)]) == 1
    said = capsys.readouterr().out
    assert "re-run by us" in said and "removed: " in said and "s of CPU when run again" in said
    for text, words in (('"ours.zip" = "best"', "must be one of independent"), ('"our.zip" = "ours"', "our.zip")):
        (folder / ladder.LABEL_FILE).write_text(text + "\n")
        assert main(["ladder", str(folder)]) == 2
        assert words in capsys.readouterr().err
