"""Writes `catalogue.fits`, `catalogue.vot`, `catalogue2.vot` and `catalogue.ecsv.zst`: the same 200 stars in the layouts of the FITS
standard 4.0 (section 7.3), of VOTable 1.4 (BINARY and BINARY2) and of ECSV 1.0, byte by byte, with nothing but Python's own modules and
the program `zstd`. What is in them, `crates/data/tests/catalogues/formats.rs` says again."""

import base64
import struct
import subprocess

ROWS = 200


def star(i):
    return {
        "id": (1 << 63) + (1 << 60) + i,
        "ra": 1.75 * i,
        "dec": -60 + 0.6 * i,
        "parallax": None if i == 7 else 2 + 0.25 * i,
        "flag": [True, False, None][i % 3],
        # Stored as half of what is above 10.
        "level": None if i % 10 == 9 else 10 + 0.5 * i,
        "pm": [i, -i, 0.5 * i],
        "bits": i * 7 % 2048,
        "name": f"star {i}",
    }


STARS = [star(i) for i in range(ROWS)]


def filled(data, fill):
    return data + fill * (-len(data) % 2880)


def header(*cards):
    lines = []
    for name, value in cards:
        if isinstance(value, str):
            value = "'" + value.replace("'", "''").ljust(8) + "'"
        else:
            value = str({True: "T", False: "F"}[value] if isinstance(value, bool) else value).rjust(20)
        lines.append(f"{name:<8}= {value} / of the test".ljust(80))
    return filled("".join(lines + ["END".ljust(80)]).encode(), b" ")


def bintable(columns, rows, row, *more):
    cards = [("XTENSION", "BINTABLE"), ("BITPIX", 8), ("NAXIS", 2), ("NAXIS1", row), ("NAXIS2", rows), ("PCOUNT", 0), ("GCOUNT", 1)]
    cards.append(("TFIELDS", len(columns)))
    for number, column in enumerate(columns, 1):
        cards += [(f"{key}{number}", value) for key, value in column.items()]
    return header(*cards, *more)


def fits():
    primary = header(("SIMPLE", True), ("BITPIX", 8), ("NAXIS", 0), ("EXTEND", True), ("OBJECT", "it's no star"))
    other = bintable([{"TTYPE": "flux", "TFORM": "E", "TUNIT": "Jy"}], 3, 4)
    other += filled(struct.pack(">3f", 1, 2, 3), b"\0")
    columns = [
        {"TTYPE": "id", "TFORM": "K", "TZERO": 1 << 63},
        {"TTYPE": "ra", "TFORM": "1D", "TUNIT": "deg"},
        {"TTYPE": "name", "TFORM": "9A"},
        {"TTYPE": "dec", "TFORM": "D", "TUNIT": "deg"},
        {"TTYPE": "parallax", "TFORM": "E", "TUNIT": "mas"},
        {"TTYPE": "flag", "TFORM": "L"},
        {"TTYPE": "level", "TFORM": "1I", "TSCAL": 0.5, "TZERO": "1.0D1", "TNULL": -99, "TUNIT": "m"},
        {"TTYPE": "list", "TFORM": "1PE(3)"},
        {"TTYPE": "pm", "TFORM": "3E", "TUNIT": "mas/yr"},
        {"TTYPE": "bits", "TFORM": "11X"},
        {"TTYPE": "none", "TFORM": "0J"},
    ]
    row = struct.Struct(">qd9sdfchiifff2s")
    table = bintable(columns, ROWS, row.size, ("EXTNAME", "STARS"))
    # TZERO of a level is a number, though written with Fortran's exponent.
    table = table.replace(b"'1.0D1   '", b" 1.0D1    ")
    for s in STARS:
        parallax = float("nan") if s["parallax"] is None else s["parallax"]
        flag = {True: b"T", False: b"F", None: b"\0"}[s["flag"]]
        level = -99 if s["level"] is None else int((s["level"] - 10) / 0.5)
        bits = struct.pack(">H", s["bits"] << 5)
        table += row.pack(s["id"] - (1 << 63), s["ra"], s["name"].encode(), s["dec"], parallax, flag, level, 0, 0, *s["pm"], bits)
    return primary + other + filled(table, b"\0")


FIELDS = """      <FIELD name="id" datatype="long"/>
      <FIELD ID="ra" datatype="double" unit="deg"><DESCRIPTION>0 &lt; ra > -1</DESCRIPTION></FIELD>
      <FIELD name="name" datatype="char" arraysize="*"/>
      <FIELD name="dec" datatype="double" unit="deg"/>
      <FIELD name="parallax" datatype="float" unit="mas"/>
      <FIELD name="flag" datatype="boolean"/>
      <FIELD name="level" datatype="short" unit="m"><VALUES null="-99"/></FIELD>
      <FIELD name="pm" datatype="float" arraysize="3" unit="mas/yr"/>
      <FIELD name="bits" datatype="bit" arraysize="11"/>
"""


def votable(serialization):
    rows = b""
    for s in STARS:
        missing = [0, 0, 0, 0, s["parallax"] is None, s["flag"] is None, s["level"] is None, 0, 0]
        if serialization == "BINARY2":
            word = sum(int(flag) << (15 - bit) for bit, flag in enumerate(missing))
            rows += struct.pack(">H", word)
        name = s["name"].encode()
        parallax = s["parallax"] if s["parallax"] is not None else float("nan") if serialization == "BINARY" else 0
        flag = {True: b"T", False: b"F", None: b"?"}[s["flag"]]
        level = 2 * s["level"] if s["level"] is not None else -99
        rows += struct.pack(">qd", s["id"] % (1 << 60), s["ra"]) + struct.pack(">i", len(name)) + name
        rows += struct.pack(">dfch", s["dec"], parallax, flag, int(level)) + struct.pack(">fff", *s["pm"]) + struct.pack(">H", s["bits"] << 5)
    code = base64.encodebytes(rows).decode()
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<!-- <TABLE> -->
<VOTABLE version="1.4" xmlns="http://www.ivoa.net/xml/VOTable/v1.3">
  <RESOURCE type="results">
    <TABLE name="other"><FIELD name="flux" datatype="float"/><DATA><TABLEDATA><TR><TD>1</TD></TR></TABLEDATA></DATA></TABLE>
    <TABLE name="stars" nrows="{ROWS}">
      <PARAM name="p" datatype="int" value="3"><VALUES null="3"/></PARAM>
{FIELDS}      <DATA><{serialization}><STREAM encoding='base64'>
{code}</STREAM></{serialization}></DATA>
    </TABLE>
  </RESOURCE>
</VOTABLE>
""".encode()


def ecsv():
    head = """# %ECSV 1.0
# ---
# delimiter: ','
# datatype:
# - {name: id, datatype: int64}
# - {name: ra, unit: deg, datatype: float64, description: 'right ascension, {ICRS}: J2016',
#   format: '%.3f'}
# - {name: name, datatype: string}
# -
#   name: dec
#   unit: deg
#   datatype: float64
#   description: >
#     name: none
# - {name: parallax, unit: mas, datatype: float32}
# - {name: flag, datatype: bool}
# - {name: level, unit: m, datatype: float32}
# meta: !!omap
# - {made: by hand}
# schema: astropy-2.0
id,ra,name,dec,parallax,flag,level
"""
    text = {None: "", True: "True", False: "False"}
    lines = []
    for s in STARS:
        parallax = "null" if s["parallax"] is None else s["parallax"]
        level = "" if s["level"] is None else s["level"]
        lines.append(f"{s['id'] % (1 << 60)},{s['ra']},\"{s['name']}, it is\",{s['dec']},{parallax},{text[s['flag']]},{level}\n")
    return head.encode(), "".join(lines).encode()


def zstd(data):
    return subprocess.run(["zstd", "-q", "-19", "--check", "-c"], input=data, stdout=subprocess.PIPE, check=True).stdout


def main():
    with open("catalogue.fits", "wb") as file:
        file.write(fits())
    for name, serialization in (("catalogue.vot", "BINARY"), ("catalogue2.vot", "BINARY2")):
        with open(name, "wb") as file:
            file.write(votable(serialization))
    # Two frames, with one that holds nothing between them.
    head, rows = ecsv()
    with open("catalogue.ecsv.zst", "wb") as file:
        file.write(zstd(head) + struct.pack("<II", 0x184D2A53, 5) + b"hello" + zstd(rows))


main()
