"""Logs that are wrong, each in one way, and logs that say the same right numbers in many ways.

Every case writes its file into a folder and knows the study that reads it; nothing is kept in the repository.
"""
# ruff: noqa: E501  # one case a line is easier to read than a case over five

import gzip
import io
import os
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.io

MODELS = Path(__file__).resolve().parents[2] / "models"
N = 40
TIME = np.arange(N) / 100
VOLTAGE = np.where(np.arange(N) % 20 < 10, 1.5, -0.5)
PLACE = np.round(1234.5 + 0.3 * np.sin(9 * TIME), 6)
"""Above a thousand, for marks between thousands."""

STUDY = """
[model]
path = "{models}/{model}"

[parameters."{parameter}"]
guess = {guess}

[[experiment]]
name = "run"
file = "{file}"
{time}
{inputs}
{outputs}
{more}
"""
SERVO = {
    "model": "emps.py",
    "parameter": "axis.m",
    "guess": "80.0",
    "time": 'time = { column = "t" }',
    "inputs": 'inputs = { "drive.u" = { column = "u", unit = "V" } }',
    "outputs": 'outputs = { "encoder.s" = { column = "s", unit = "m" } }',
    "more": "",
}


@dataclass(frozen=True)
class Case:
    """A log: what writes it, what the study says otherwise than `SERVO`, and for a bad one what must be answered."""

    file: str
    write: Callable[[Path], object]
    sentence: str = ""
    study: dict[str, str] | None = None
    needs: str | None = None

    def make(self, folder: Path) -> Path:
        """Write log and study; return the study."""
        self.write(folder / self.file)
        path = folder / "study.toml"
        path.write_text(STUDY.format(models=MODELS, file=self.file, **SERVO | (self.study or {})), "utf-8")
        return path


def rows(delimiter=",", decimal=".", thousands="", header="t,u,s", quote=""):
    """Write the right numbers as text, with the header in the same dialect."""

    def cell(x):
        text = f"{x:{',' if thousands else ''}.6f}"
        return quote + text.replace(".", "D").replace(",", thousands).replace("D", decimal) + quote

    lines = [header.replace(",", delimiter)] if header else []
    return lines + [delimiter.join(map(cell, row)) for row in zip(TIME, VOLTAGE, PLACE, strict=True)]


def text(lines, encoding="utf-8", end="\n"):
    return lambda path: path.write_bytes((end.join(lines) + end).encode(encoding))


def raw(content):
    return lambda path: path.write_bytes(content)


def changed(row, cell, value, **dialect):
    """Replace a cell of the right numbers; row 0 is the first row of numbers, cells are t, u, s."""
    lines = rows(**dialect)
    delimiter = dialect.get("delimiter", ",")
    cells = lines[row + 1].split(delimiter)
    cells[cell] = value
    lines[row + 1] = delimiter.join(cells)
    return text(lines)


def column(cell, values):
    lines = rows()
    for k, value in enumerate(values):
        cells = lines[k + 1].split(",")
        cells[cell] = str(value)
        lines[k + 1] = ",".join(cells)
    return text(lines)


def line(row, content):
    lines = rows()
    lines[row + 1] = content
    return text(lines)


def mat(**content):
    return lambda path: scipy.io.savemat(path, {"t": TIME, "u": VOLTAGE, "s": PLACE} | content)


def mat_bytes(compress=False):
    stream = io.BytesIO()
    scipy.io.savemat(stream, {"t": TIME, "u": VOLTAGE, "s": PLACE}, do_compression=compress)
    return stream.getvalue()


def claimed(packed):
    """A variable `s` of 250,000,000 doubles, of which nothing follows."""
    n_bytes = 2_000_000_000
    body = struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIII", 5, 8, n_bytes // 8, 1)
    body += struct.pack("<HH4s", 1, 1, b"s") + struct.pack("<II", 9, n_bytes)
    element = struct.pack("<II", 14, len(body) + n_bytes) + body
    if packed:
        inner = zlib.compress(element)
        element = struct.pack("<II", 15, len(inner)) + inner
    return b"MATLAB 5.0 MAT-file, Platform: none".ljust(124) + b"\x00\x01IM" + element


def hdf5(path, *, matlab=False, claim=False, elsewhere=False, nested=False):
    import h5py

    with h5py.File(path, "w", userblock_size=512 if matlab else 0) as file:
        for name, values in (("t", TIME), ("u", VOLTAGE), ("s", PLACE)):
            home = file.require_group("run") if nested else file
            if name == "s" and claim:
                file.create_dataset("s", (250_000_000, 1), "f8", chunks=(1000, 1))
            elif name == "s" and elsewhere:
                file["s"] = h5py.ExternalLink("/etc/passwd", "/s")
            else:
                home.create_dataset(name, data=values[None, :] if matlab else values)
    if matlab:
        with path.open("r+b") as raw_file:
            raw_file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def parquet(path, **columns):
    import pyarrow
    from pyarrow import parquet as pq

    pq.write_table(pyarrow.table({"t": TIME, "u": VOLTAGE, "s": PLACE} | columns), path)


def cut(write, share):
    """Write a file and keep the first part of it only."""

    def short(path):
        write(path)
        path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])

    return short


def zipped():
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        file.writestr("run.csv", "\n".join(rows()))
    return stream.getvalue()


def hole(path):
    with path.open("wb") as file:
        file.truncate(2_000_000_000)


def beside(name, lines):
    """Write the run as it should be, and another file beside it."""

    def both(path):
        text(rows())(path)
        if lines is not None:
            text(lines)(path.parent / name)

    return both


def other(extra=""):
    return {"outputs": f'outputs = {{ "encoder.s" = {{ column = "s", file = "other.csv"{extra} }} }}'}


def pendulum(extra=""):
    return {
        "model": "rota_damp.py",
        "parameter": "bearing.d",
        "guess": "0.03",
        "inputs": "",
        "outputs": 'outputs = { "bearing.phi" = { column = "s", unit = "deg" } }',
        "time": f'time = {{ column = "t"{extra} }}',
    }


def gappy(every, pause):
    """Time stamps with a pause after each few samples."""
    return TIME + pause * (np.arange(N) // every)


NOT_TEXT = r"the file is not text; csv, txt, mat and parquet files can be read, and this is "
NOT_MAT = "the file is not a MATLAB file that can be read: "
NO_UNIT = {"outputs": 'outputs = { "encoder.s" = { column = "s" } }'}

BAD: dict[str, Case] = {
    # nothing there
    "missing": Case("run.csv", lambda path: None, r"run\.csv: .*there is no such data file\."),
    "folder": Case("run.csv", lambda path: path.mkdir(), "this is a folder; name the data file in it"),
    "pipe": Case("run.csv", os.mkfifo, "this is no ordinary file; write the data to a csv"),
    "link to nowhere": Case("run.csv", lambda path: path.symlink_to("gone.csv"), "there is no such data file"),
    "link to itself": Case("run.csv", lambda path: path.symlink_to(path.name), "there is no such data file|cannot be read"),
    "empty": Case("run.csv", raw(b""), r"the file holds no data"),
    "blank lines": Case("run.csv", raw(b"\n \n\n"), "the file holds no data"),
    "header only": Case("run.csv", text(["t,u,s"]), "the file holds no data"),
    "header and units only": Case("run.csv", text(["t,u,s", "s,V,m"]), "the file holds no data|'s' in row 0"),
    "comments only": Case("run.csv", text(["# rig 3", "# nothing came"]), "the file holds no data"),
    # not text
    "zip renamed": Case("run.csv", raw(zipped()), NOT_TEXT + "a zip archive or an Excel workbook: unpack it"),
    "gzip renamed": Case("run.csv", raw(gzip.compress(b"t,u,s\n")), NOT_TEXT + "packed by gzip: unpack it"),
    "old Excel": Case("run.txt", raw(b"\xd0\xcf\x11\xe0" + bytes(600)), NOT_TEXT + "an Excel workbook: save the sheet"),
    "pdf": Case("run.csv", raw(b"%PDF-1.7\n1 0 obj"), NOT_TEXT + "a PDF document: export"),
    "npy": Case("run.txt", raw(b"\x93NUMPY\x01\x00" + bytes(80)), NOT_TEXT + "an array of numpy: save it by numpy.savetxt"),
    "sqlite": Case("run.csv", raw(b"SQLite format 3\0" + bytes(80)), NOT_TEXT + "an SQLite database: export"),
    "mat named csv": Case("run.csv", raw(mat_bytes()), NOT_TEXT + r"a MATLAB file: name it \.mat"),
    "hdf5 named csv": Case("run.csv", raw(b"\x89HDF\r\n\x1a\n" + bytes(80)), NOT_TEXT + r"an HDF5 file: name it \.h5"),
    "parquet named csv": Case("run.csv", raw(b"PAR1" + bytes(80)), NOT_TEXT + r"a parquet file: name it \.parquet"),
    "NUL bytes inside": Case(
        "run.csv",
        raw("\n".join(rows()).encode().replace(b"0.100000", b"0.1\0\0\0\0\0")),
        r"holds a NUL byte at position \d+: it is binary or was damaged; export it again",
    ),
    "2 GB of nothing": Case("run.csv", hole, "holds a NUL byte at position 0: .* export it again"),
    "utf-32 without a mark": Case("run.csv", text(rows(), "utf-32-le"), "holds a NUL byte at position 1"),
    "one endless line": Case("run.csv", raw(b"1," * 600_000), "line 1 has more than 1000000 characters"),
    "EBCDIC": Case("run.csv", text(rows(), "cp500"), r"the file holds no data|has no header|is no column"),
    "html page": Case(
        "run.csv", text(["<!DOCTYPE html>", "<html><body>", "Please log in", "</body></html>"]), "there is no column `t`|the header names"
    ),
    "json": Case("run.csv", text(["{", '"t": [0, 1, 2],', '"s": [1, 2, 3]', "}"]), "the header names|no column|cells"),
    # not a table
    "row too short": Case("run.csv", line(7, "0.07,1.5"), r"row 7 has 2 cells, the first row 3: '0\.07,1\.5'; mend"),
    "row too long": Case("run.csv", line(9, "0.09,1,5,2.0"), r"row 9 has 4 cells, the first row 3: .*; mend the row"),
    "truncated in a row": Case("run.csv", cut(text(rows()), 0.8 + 0.007), r"row \d+ has \d cells, the first row 3"),
    "quote never closed": Case("run.csv", line(5, '0.05,"1.5,2.0'), "row 5 opens a quote .* that is never closed; mend"),
    "no header": Case("run.csv", text(rows(header="")), "the file has no header, but the rows have 3, .*`format.columns`"),
    "header too short": Case("run.csv", text(rows(header="t,u")), "the header names 2 columns, but the rows have 3"),
    "too many names": Case(
        "run.csv", text(rows(header="")), "`format.columns` names 4 columns, but the rows have 3",
        {"more": 'format = { columns = ["t", "u", "s", "w"] }'},
    ),
    "words before the header": Case(
        "run.csv", text(["Logger 3", "Serial: 77", *rows()]), r"row 1 has 3 cells, the first row 1: .*lines before the header by `format\.skip_rows`"
    ),
    # columns
    "wrong column": Case("run.csv", text(rows(header="t,u,position")), r"there is no column `s`\. The columns are: `t`, `u`, `pos"),
    "misspelt columns": Case("run.csv", text(rows(header="T,u,ss")), r"no column `t`, `s`; did you mean `ss`\?"),
    "bracket that is no unit": Case("run.csv", text(rows(header="t,u,s [raw]")), r"no column `s`[.] .*`s \[raw\]`"),
    # numbers
    "text in numbers": Case("run.csv", changed(7, 2, "n.a.?"), r"`s` holds 'n\.a\.\?' in row 7, .*not a number \(1 such rows\).*leave"),
    "unit in the cell": Case("run.csv", changed(3, 1, "1.5 V"), r"`u` holds '1\.5 V' in row 3, which is not a number"),
    "error of a spreadsheet": Case("run.csv", changed(4, 2, "#DIV/0!"), r"`s` holds '#DIV/0!' in row 4"),
    "hexadecimal": Case("run.csv", changed(4, 2, "0x1F4"), "`s` holds '0x1F4' in row 4"),
    "two decimal marks": Case(
        "run.csv", changed(30, 2, "1234.5", delimiter=";", decimal=","),
        r"`s` holds '1234\.5' in row 30, .*; numbers are read with the decimal mark `,`; leave",
    ),
    "comma inside a number": Case("run.csv", changed(20, 2, '"12,34.5"'), r"`s` holds '12,34\.5' in row 20, which is not"),
    "wrong digits between thousands": Case(
        "run.csv", changed(20, 2, "1.23,5", delimiter=";", decimal=",", thousands="."), r"holds '1\.23,5' in row 20, .*`\.` between thousands"
    ),
    "dates as time": Case(
        "run.csv", column(0, [f"2024-05-01T12:00:{k:02d}" for k in range(N)]), r"`t` holds '2024-05-01T12:00:00' in row 0, .*write the time in seconds"
    ),
    "dates as values": Case("run.csv", column(2, ["2024-05-01"] * N), r"`s` holds '2024-05-01' in row 0, .*\(40 such rows\)"),
    "infinite output": Case("run.csv", changed(5, 2, "inf"), r"`s` has no finite value in row 5, but inf \(1 such rows\); leave"),
    "infinite input": Case("run.csv", changed(6, 1, "-inf"), "`u` has no finite value in row 6, but -inf"),
    "overflow": Case("run.csv", changed(6, 2, "1e999"), r"`s` has no finite value in row 6, but inf|`s` holds '1e999' in row 6"),
    "NaN everywhere": Case("run.csv", column(2, ["nan"] * N), "the output column `s` has 0 finite values; at least 10 are needed"),
    "input NaN everywhere": Case("run.csv", column(1, [""] * N), "the input column `u` has 0 finite values; at least 10"),
    "hardly any value": Case("run.csv", column(2, ["1.0"] * 9 + [""] * 31), "`s` has 9 finite values; at least 10"),
    # time
    "time empty": Case("run.csv", changed(8, 0, ""), r"the time column `t` is empty in row 8 \(1 such rows\); choose"),
    "time infinite": Case("run.csv", changed(39, 0, "inf"), "`t` has no finite value in row 39"),
    "doubled time": Case("run.csv", changed(8, 0, "0.07"), r"not increase at row 8: 0\.07 s after 0\.07 s \(1 such rows\); .*one row of each"),
    "all times doubled": Case("run.csv", column(0, np.repeat(TIME[:20], 2)), r"at row 1: 0 s after 0 s \(20 such rows\)"),
    "time stands": Case("run.csv", column(0, [3.0] * N), r"at row 1: 3 s after 3 s \(39 such rows\)"),
    "time runs backwards": Case("run.csv", column(0, TIME[::-1]), r"row 1: 0\.38 s after 0\.39 s \(39 such rows\); .*backwards"),
    "clock starts again": Case("run.csv", column(0, TIME % 0.2), r"at row 20: 0 s after 0\.19 s \(1 such rows\)"),
    "time in ms labelled s": Case(
        "run.csv", text(rows(header="t [ms],u,s")), "gives the column `t` in `ms`, but the study in `s`; mend the study",
        {"time": 'time = { column = "t", unit = "s" }'},
    ),
    "ms taken for s": Case(
        "run.csv", column(0, 10 * np.arange(N)), r"samples are 10 s apart, but the slowest motion .* vibration of 1\.5\d s; if .*`ms`", pendulum()
    ),
    "time in volts": Case("run.csv", text(rows(header="t [V],u,s")), "column `t` in `V`, but a time is needed"),
    "gaps everywhere": Case("run.csv", column(0, gappy(5, 1.0)), r"40 samples in 8 pieces are too few; at least 10 without a gap .*hold"),
    "endless gap held": Case(
        "run.csv", column(0, gappy(20, 1e6)), r'"hold" across 1e\+06 s after 0\.19 s would take \d+ steps of 0\.01 s', {"more": 'gap = "hold"'}
    ),
    # units
    "unit in the header": Case("run.csv", text(rows(header="t,u,s [mm]")), "gives the column `s` in `mm`, but the study in `m`; mend"),
    "unit row": Case("run.csv", text(["t,u,s", "s,mV,m", *rows(header="")]), "gives the column `u` in `mV`, but the study in `V`"),
    "unit of another quantity": Case(
        "run.csv", text(rows(header="t,u,s [kg]")), "gives the column `s` in `kg`, but the model has it in `m`: .*Name another", NO_UNIT
    ),
    "Hz for rad/s": Case(
        "run.csv", text(rows(header="t,u,s (Hz)")), "column `s` in `Hz`, but the model has it in `m`", NO_UNIT
    ),
    "unit of the study": Case(
        "run.csv", text(rows()), "is read in `V`, but the model has it in `m`",
        {"outputs": 'outputs = { "encoder.s" = { column = "s", unit = "V" } }'},
    ),
    # parts of a file
    "rows beyond": Case("run.csv", text(rows()), "`rows` ends at 40, but the last row of the file is 39", {"more": "rows = [0, 40]"}),
    "window elsewhere": Case("run.csv", text(rows()), r"\[5, 9\] s holds no sample; the run was recorded from 0 s to 0\.39 s", {"more": "window = [5.0, 9.0]"}),
    "window too short": Case("run.csv", text(rows()), "5 samples are too few; at least 10", {"more": "window = [0.1, 0.142]"}),
    "few rows": Case("run.csv", text(rows()[:6]), "5 samples are too few; at least 10 are needed"),
    # several files
    "other file missing": Case("run.csv", beside("other.csv", None), r"other\.csv: experiment `run`: there is no such", other()),
    "clocks differ": Case(
        "run.csv", beside("other.csv", ["t,s", *(f"{100 + t:g},{s}" for t, s in zip(TIME, PLACE, strict=True))]),
        r"other\.csv: .*`s` was recorded from 100 s to 100\.39 s and the rest .*`shift`", other(),
    ),
    "column not in the other file": Case("run.csv", beside("other.csv", rows(header="t,u,x")), r"other\.csv: .*no column `s`", other()),
    # MATLAB
    "text named mat": Case("run.mat", text(rows()), NOT_MAT + r"it is text; name it \.csv"),
    "empty mat": Case("run.mat", raw(b""), "the file is empty: the file is not a MATLAB file"),
    "mat of noise": Case("run.mat", raw(bytes(np.random.default_rng(3).integers(0, 256, 4000, np.uint8))), NOT_MAT),
    "mat header only": Case("run.mat", raw(mat_bytes()[:128]), r"no column `t`, `u`, `s`[.] It has no numeric columns"),
    "mat truncated": Case("run.mat", raw(mat_bytes()[:700]), NOT_MAT),
    "packed mat truncated": Case("run.mat", raw(mat_bytes(compress=True)[:-60]), NOT_MAT),
    "mat claims 2 GB": Case("run.mat", raw(claimed(False)), r"`s` \(250000000x1\) would take 2\.0 GB of memory, .*cut the file"),
    "packed mat claims 2 GB": Case("run.mat", raw(claimed(True)), r"`s` \(250000000x1\) would take 2\.0 GB of memory"),
    "no such variable": Case("run.mat", lambda path: scipy.io.savemat(path, {"t": TIME, "u": VOLTAGE}), "no column `s`[.] .*`t`, `u`"),
    "variable of text": Case("run.mat", mat(s="warm"), "no column `s`[.] .*`t`, `u`"),
    "complex variable": Case("run.mat", mat(s=PLACE * 1j), "no column `s`"),
    "three dimensions": Case("run.mat", mat(s=np.zeros((N, 2, 2))), "no column `s`"),
    "unequal lengths": Case("run.mat", mat(s=PLACE[:-1]), "the columns differ in length: `t` 40, `u` 40, `s` 39; name a column"),
    "half of a matrix": Case("run.mat", mat(s=np.column_stack([PLACE, PLACE])), r"no column `s`[.] .*`s\(:,1\)`, `s\(:,2\)`"),
    "7.3 of noise": Case(
        "run.mat", raw(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(500)), NOT_MAT + "|which needs h5py"
    ),
    "7.3 truncated": Case("run.mat", cut(lambda path: hdf5(path, matlab=True), 0.5), NOT_MAT, needs="h5py"),
    # HDF5 and parquet
    "h5 of noise": Case("run.h5", raw(b"noise" * 100), "the file is not an HDF5 file that can be read: .*save it again", needs="h5py"),
    "h5 claims 2 GB": Case("run.h5", lambda path: hdf5(path, claim=True), r"`s` \(250000000x1\) would take 2\.0 GB", needs="h5py"),
    "h5 that points elsewhere": Case("run.h5", lambda path: hdf5(path, elsewhere=True), "no column `s`", needs="h5py"),
    "parquet of noise": Case("run.parquet", raw(b"PAR1 no more"), "not a parquet file|needs pyarrow"),
    "parquet truncated": Case("run.parquet", cut(parquet, 0.6), "not a parquet file .*export it again", needs="pyarrow"),
    "empty parquet": Case("run.parquet", raw(b""), "the file is empty: the file is not a parquet file"),
    "parquet with text": Case("run.parquet", lambda path: parquet(path, s=["a"] * N), "`s` holds 'a' in row 0", needs="pyarrow"),
    "parquet with dates": Case(
        "run.parquet", lambda path: parquet(path, s=np.datetime64("2024-05-01", "s") + np.arange(N)), "`s` holds dates, which only", needs="pyarrow"
    ),
}  # fmt: skip


def in_columns(names):
    """Read the columns by other names."""
    t, u, s = names
    return {
        "time": f"time = {{ column = '{t}' }}",
        "inputs": f"inputs = {{ \"drive.u\" = {{ column = '{u}' }} }}",
        "outputs": f"outputs = {{ \"encoder.s\" = {{ column = '{s}' }} }}",
    }


def shuffled():
    return [",".join((a, "note", c, b)) for a, b, c in (one.split(",") for one in rows(header="t,u,s"))]


SCALED = ["t [ms],u [mV],s [mm]"] + [
    f"{1000 * t:.6f},{1000 * u:.6f},{1000 * s:.6f}" for t, u, s in zip(TIME, VOLTAGE, PLACE, strict=True)
]
GOOD: dict[str, Case] = {
    "comma": Case("run.csv", text(rows())),
    "semicolon and decimal comma": Case("run.csv", text(rows(";", ","))),
    "tab": Case("run.txt", text(rows("\t"))),
    "spaces": Case("run.txt", text(rows("   "))),
    "bar": Case("run.csv", text(rows("|"))),
    "german thousands": Case("run.csv", text(rows(";", ",", "."))),
    "english thousands": Case("run.csv", text(rows(";", ".", ","))),
    "quoted english thousands": Case("run.csv", text(rows(",", ".", ",", quote='"'))),
    "swiss thousands": Case("run.csv", text(rows(";", ".", "'"))),
    "french thousands": Case("run.csv", text(rows(";", ",", " "))),
    "stated thousands": Case("run.csv", text(rows(";", ".", ",")), study={"more": 'format = { thousands = "," }'}),
    "byte order mark": Case("run.csv", text(rows(), "utf-8-sig")),
    "latin-1": Case("run.csv", text(["# Prüfstand", *rows()], "latin-1")),
    "utf-16": Case("run.csv", text(rows(), "utf-16")),
    "utf-16 without a mark": Case("run.csv", text(rows(), "utf-16-le")),
    "utf-32": Case("run.csv", text(rows(), "utf-32")),
    "lines of Windows": Case("run.csv", text(rows(), end="\r\n")),
    "lines of an old Macintosh": Case("run.csv", text(rows(), end="\r")),
    "comments": Case("run.csv", text(["# rig 3", "", *rows()[:9], "# a pause", *rows()[9:]])),
    "words before the header": Case("run.csv", text(["Logger 3", "", *rows()]), study={"more": "format = { skip_rows = 2 }"}),
    "Excel's own line": Case("run.csv", text(["sep=;", *rows(";", ",")])),
    "unit row": Case("run.csv", text(["t,u,s", "s,V,m", *rows(header="")])),
    "unit row in brackets": Case("run.csv", text(["t;u;s", "[s];[V];[m]", *rows(";", ",", header="")])),
    "units in the header": Case("run.csv", text(rows(header="t [s],u (V),s [m]"))),
    "other units in the header": Case("run.csv", text(SCALED), study=in_columns("tus")),
    "other units, name in full": Case("run.csv", text(SCALED), study=in_columns(["t [ms]", "u [mV]", "s [mm]"])),
    "wrong units in the header": Case(
        "run.csv", text(rows(header="t [ms],u [kg],s [K]")), study=in_columns("tus") | {"more": 'format = { units = "study" }'}
    ),
    "quoted": Case("run.csv", text(rows(header='"t","u","s"', quote='"'))),
    "other columns of text": Case("run.csv", text([one.replace("t,note,", "t,n,", 1) for one in shuffled()])),
    "delimiter at the end": Case("run.csv", text([one + "," for one in rows()])),
    "sample rate": Case(
        "run.csv", text(rows()), study={"time": "", "more": "format = { sample_rate = 100.0 }"}
    ),
    "MATLAB 5": Case("run.mat", mat()),
    "packed MATLAB 5": Case("run.mat", raw(mat_bytes(compress=True))),
    "MATLAB matrix": Case(
        "run.mat", lambda path: scipy.io.savemat(path, {"A": np.column_stack([TIME, VOLTAGE, PLACE])}), study=in_columns(["A(:,1)", "A(:,2)", "A(:,3)"])
    ),
    "MATLAB structure with time": Case(
        "run.mat",
        lambda path: scipy.io.savemat(
            path, {"out": {"time": TIME, "signals": np.array([{"values": VOLTAGE}, {"values": PLACE}], object)}}
        ),
        study=in_columns(["out.time", "out.signals(1).values", "out.signals(2).values"]),
    ),
    "MATLAB cells": Case(
        "run.mat",
        lambda path: scipy.io.savemat(path, {"c": np.array([TIME, VOLTAGE, PLACE, "x"], object)}),
        study=in_columns(["c{1}", "c{2}", "c{3}"]),
    ),
    "MATLAB 4": Case("run.mat", lambda path: scipy.io.savemat(path, {"t": TIME, "u": VOLTAGE, "s": PLACE}, format="4")),
    "MATLAB 7.3": Case("run.mat", lambda path: hdf5(path, matlab=True), needs="h5py"),
    "MATLAB 7.3 structure": Case(
        "run.mat", lambda path: hdf5(path, matlab=True, nested=True), study=in_columns(["run.t", "run.u", "run.s"]), needs="h5py"
    ),
    "HDF5": Case("run.h5", hdf5, needs="h5py"),
    "parquet": Case("run.parquet", parquet, needs="pyarrow"),
    "parquet with dates as time": Case(
        "run.parquet",
        lambda path: parquet(path, t=np.datetime64("2024-05-01") + np.arange(N) * np.timedelta64(10, "ms")),
        needs="pyarrow",
    ),
}  # fmt: skip
