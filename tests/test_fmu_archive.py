"""FMU files from anybody: what is not in order gets one sentence, and nothing is written outside the folder."""

import random
import shutil
import struct
import tempfile
import zipfile
from collections import Counter

import fmpy
import foreign_fmus
import pytest

from cartpend_dae.errors import StudyError
from cartpend_dae.fmi.archive import Limits, unpacked, wrong_name
from cartpend_dae.fmi.check import check_fmu
from cartpend_dae.fmi.foreign import library_problem, load_fmu

LIBRARY = f"binaries/{fmpy.platform}/hopper.so"
TEXT = foreign_fmus.hopper_description()
LAUGHS = "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 10))
PATHS = ("../evil", "a/../../evil", "/tmp/evil", "C:/evil", "..\\evil", "a\\b", "./../evil", "resources/../../../evil")


def pack(path, members, method=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return path


@pytest.fixture(scope="module")
def hopper(tmp_path_factory):
    return foreign_fmus.build_hopper(tmp_path_factory.mktemp("hopper"))


@pytest.fixture(scope="module")
def library(hopper):
    with zipfile.ZipFile(hopper) as archive:
        return archive.read(LIBRARY)


@pytest.mark.parametrize("name", PATHS)
def test_a_path_that_leads_elsewhere_is_refused(tmp_path, name):
    path = tmp_path / "slip.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        info = zipfile.ZipInfo("x")
        info.filename = name
        archive.writestr(info, "evil")
        archive.writestr("modelDescription.xml", TEXT)
    with pytest.raises(StudyError, match=r"it holds the path .* nothing was kept"):
        load_fmu(path)
    assert wrong_name(name) and not wrong_name("resources/a..b/c.txt")


def test_a_link_is_refused(tmp_path):
    info = zipfile.ZipInfo("resources/link")
    info.external_attr = 0o120777 << 16
    path = pack(tmp_path / "link.fmu", [(info, "/etc/passwd"), ("modelDescription.xml", TEXT)])
    with pytest.raises(StudyError, match="is a link or a device"):
        load_fmu(path)


@pytest.mark.parametrize(
    "limits, match",
    [
        (Limits(files=1), "holds 2 files, and 1 at most"),
        (Limits(total_bytes=100), "would take .* MB, and 0 MB at most"),
        (Limits(file_bytes=100), "`modelDescription.xml` in it would take"),
        (Limits(ratio=5.0), "looks like a zip bomb"),
        (Limits(xml_depth=2, ratio=2000.0), "nested deeper than 2"),
        (Limits(xml_bytes=10, ratio=2000.0), "its modelDescription.xml has 0 MB"),
    ],
)
def test_sizes_and_counts_are_bounded(tmp_path, limits, match):
    path = pack(tmp_path / "big.fmu", [("modelDescription.xml", TEXT), ("resources/zeros", bytes(3 << 20))])
    with pytest.raises(StudyError, match=match), unpacked(path, limits):
        pass


def test_a_size_that_the_file_understates_is_found_while_unpacking(tmp_path):
    path = pack(tmp_path / "liar.fmu", [("modelDescription.xml", TEXT), ("resources/zeros", bytes(100_000))])
    data = bytearray(path.read_bytes())
    real, false = struct.pack("<I", 100_000), struct.pack("<I", 10)
    assert data.count(real) == 2  # the local header and the central directory
    path.write_bytes(bytes(data.replace(real, false)))
    with pytest.raises(StudyError, match="damaged"):
        load_fmu(path)


@pytest.mark.parametrize(
    "head",
    [
        f"<!DOCTYPE x [<!ENTITY a0 'ha'>{LAUGHS}]>",
        "<!DOCTYPE x [<!ENTITY file SYSTEM 'file:///etc/passwd'>]>",
        "<!DOCTYPE fmiModelDescription SYSTEM 'http://127.0.0.1/x.dtd'>",
    ],
)
def test_entities_are_refused_before_a_parser_expands_them(tmp_path, head):
    text = TEXT.replace("<fmiModelDescription", f"{head}<fmiModelDescription", 1)
    with pytest.raises(StudyError, match="has a document type or entities"):
        load_fmu(pack(tmp_path / "laughs.fmu", [("modelDescription.xml", text)]))


def test_a_sentence_for_every_plain_mistake(tmp_path):
    def said(members):
        with pytest.raises(StudyError) as caught:
            load_fmu(pack(tmp_path / "x.fmu", members))
        return str(caught.value)

    assert "holds no modelDescription.xml" in said([("a.txt", "a")])
    assert "is no XML" in said([("modelDescription.xml", TEXT[:400])])
    assert "about `html`" in said([("modelDescription.xml", "<html/>")])
    assert "FMI `1.0`" in said([("modelDescription.xml", TEXT.replace('fmiVersion="2.0"', 'fmiVersion="1.0"'))])
    twice = TEXT.replace('name="v"', 'name="s"')
    assert "`s` is declared twice" in said([("modelDescription.xml", twice)])
    with pytest.raises(StudyError, match="there is no such file"):
        load_fmu(tmp_path / "none.fmu")


def mutations(random_, library):
    """Yield what is wrong and how to write the file, for ever."""

    def members(text=TEXT, code=library):
        return [("modelDescription.xml", text), (LIBRARY, code)]

    def damaged_bytes(path, change):
        pack(path, members())
        path.write_bytes(change(bytearray(path.read_bytes())))

    def cut(path):
        damaged_bytes(path, lambda data: data[: random_.randrange(len(data))])

    def flipped(path):
        def flip(data):
            for _ in range(random_.randint(1, 40)):
                data[random_.randrange(len(data))] = random_.randrange(256)
            return data

        damaged_bytes(path, flip)

    def slip(path):
        info = zipfile.ZipInfo("x")
        info.filename = random_.choice(PATHS) + str(random_.randrange(1000))
        pack(path, [*members(), (info, "evil")])

    def huge(path):
        def lie(data):
            at = data.rfind(b"PK\x01\x02")
            data[at + 24 : at + 28] = struct.pack("<I", random_.choice([2**31, 2**32 - 2, 10**9, 3 * 10**8]))
            return data

        damaged_bytes(path, lie)

    def malformed(path):
        at = random_.randrange(len(TEXT))
        piece = random_.choice(["<", "&", "</Real>", '"', "\x00", "]]>", "<!DOCTYPE a>", "&x;", "é" * 5, ""])
        width = random_.choice([0, 1, 5, 40])
        pack(path, members(TEXT[:at] + piece + TEXT[at + width :]))

    def odd(path):
        old, new = random_.choice(
            [
                ('valueReference="1"', 'valueReference="many"'),
                ('index="3"', 'index="333"'),
                ('derivative="1"', 'derivative="99"'),
                ("<ModelVariables>", "<Variables>"),
                ('modelIdentifier="hopper"', 'modelIdentifier="../hopper"'),
                ('modelIdentifier="hopper"', ""),
                ('fmiVersion="2.0"', 'fmiVersion="4.1"'),
                ('name="v"', ""),
                ('start="2"', 'start="two"'),
                ('numberOfEventIndicators="1"', 'numberOfEventIndicators="-7"'),
                ('stopTime="3"', 'stopTime="later"'),
            ]
        )
        text = TEXT.replace(old, new, 1)
        pack(path, members(text.replace("</ModelVariables>", "</Variables>") if "<Variables>" in text else text))

    def without_library(path):
        name = random_.choice(["binaries/win64/hopper.dll", "binaries/linux32/hopper.so", "resources/a.txt"])
        pack(path, [("modelDescription.xml", TEXT), (name, b"MZ")])

    def no_library(path):
        pack(path, members(code=random_.randbytes(random_.choice([0, 10, 1000]))))

    def nothing(path):
        path.write_bytes(random_.randbytes(random_.choice([0, 1, 22, 1000])))

    kinds = [cut, flipped, slip, huge, malformed, odd, without_library, no_library, nothing]
    while True:
        yield from kinds


def outcome(path):
    """Return the sentence for a file, empty if it is in order so far; its code is not run."""
    try:
        fmu = load_fmu(path)
        with unpacked(path) as folder:
            return " ".join(filter(None, (library_problem(fmu, folder, kind) for kind in fmu.description.kinds)))
    except StudyError as error:
        return str(error)


def test_a_thousand_damaged_files_get_a_sentence_each(tmp_path, library, monkeypatch):
    """Nothing escapes: the folder around and that of temporary files are empty afterwards."""
    inside = tmp_path / "temporary"
    inside.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(inside))
    path, random_ = tmp_path / "damaged.fmu", random.Random(7)
    counts, silent = Counter(), Counter()
    for kind, _ in zip(mutations(random_, library), range(1000), strict=False):
        kind(path)
        sentence = outcome(path)
        counts[kind.__name__] += 1
        if sentence:
            assert sentence.endswith((".", "'.")) and "\n" not in sentence and len(sentence) < 800, sentence
            assert "Traceback" not in sentence
        else:
            silent[kind.__name__] += 1
    assert sum(counts.values()) == 1000
    assert sorted(p.name for p in tmp_path.iterdir()) == ["damaged.fmu", "temporary"] and not list(inside.iterdir())
    # what may be in order all the same: bytes and letters that nobody reads (names, descriptions, padding)
    assert set(silent) <= {"flipped", "malformed", "odd"}, silent
    assert silent.total() < 200, silent


@pytest.mark.slow
def test_what_only_running_shows_is_told_as_well(tmp_path, hopper, library):
    """A wrong GUID, and code that is damaged: in a process of its own, whatever happens there."""
    wrong = pack(
        tmp_path / "guid.fmu", [("modelDescription.xml", TEXT.replace("{hopper}", "{other}")), (LIBRARY, library)]
    )
    report = check_fmu(wrong)
    assert (
        not report.passed
        and "fails to instantiate" in report.runs[0].problem
        and "Wrong GUID" in report.runs[0].problem
    )
    random_ = random.Random(3)
    for k in range(4):
        code = bytearray(library)
        for _ in range(3000):
            code[random_.randrange(64, len(code))] = random_.randrange(256)
        path = pack(tmp_path / f"code{k}.fmu", [("modelDescription.xml", TEXT), (LIBRARY, bytes(code))])
        report = check_fmu(path, limit=20.0)
        assert not report.passed
        assert all(run.problem.endswith(".") or run.by == "FMPy" for run in report.runs if run.problem), report
    assert shutil.which("gcc") is None or check_fmu(hopper).passed
