"""Writes `table.parquet`, 60 rows of columns of many types in three groups, `masked.parquet`, three rows with masks as astropy says them,
`unmasked.parquet`, the same without masks, `ragged.parquet`, six rows of lists of which not all are places, and `hats`, a catalogue of two partitions,
with pyarrow, which has nothing in common with the reader of the tests. What is in them, `crates/data/tests/catalogues/parquet.rs` says again."""

import decimal
import os

import pyarrow as pa
import pyarrow.parquet as pq

ROWS = 60
rows = range(ROWS)

fields = {
    "id": (pa.uint64(), [(1 << 63) + (1 << 60) + i for i in rows], None),
    "x": (pa.float64(), [None if i == 7 else 0.1 * i for i in rows], "kpc"),
    "y": (pa.float32(), [-0.5 * i for i in rows], None),
    "z": (pa.int16(), [300 - i * 10 for i in rows], None),
    "mass": (pa.decimal128(12, 3), [decimal.Decimal(1250 + i) / 1000 for i in rows], "Msun"),
    "flag": (pa.bool_(), [[True, False, None][i % 3] for i in rows], None),
    "level": (pa.int32(), [None if i % 10 == 9 else i % 4 - 1 for i in rows], "m"),
    "half": (pa.float16(), [i / 4 for i in rows], None),
    "count": (pa.uint32(), [4_000_000_000 + i for i in rows], None),
    "delta": (pa.int64(), [i * i - 100 for i in rows], None),
    "split": (pa.float64(), [i / 3 for i in rows], None),
    "name": (pa.string(), [f"row {i}" for i in rows], None),
    "list": (pa.list_(pa.int32()), [[1] * (i % 3) for i in rows], None),
    "pair": (pa.struct([("a", pa.int32()), ("b", pa.float32())]), [{"a": i, "b": 1.0} for i in rows], None),
    "when": (pa.timestamp("ms"), list(rows), None),
}
schema = pa.schema(
    [pa.field(name, kind, metadata={"unit": unit} if unit else None) for name, (kind, _, unit) in fields.items()]
)
table = pa.table([pa.array(values, kind) for kind, values, _ in fields.values()], schema)
packings = ["zstd", "snappy", "gzip", "brotli", "lz4", "none"]
leaves = [name for name in fields if name not in ("list", "pair")]
pq.write_table(
    table,
    "table.parquet",
    row_group_size=25,
    compression={name: packings[i % len(packings)] for i, name in enumerate(leaves)},
    use_dictionary=["level", "name", "mass"],
    column_encoding={"delta": "DELTA_BINARY_PACKED", "split": "BYTE_STREAM_SPLIT"},
    write_page_index=True,
)

PROPERTIES = """#HATS catalog
obs_collection=two
dataproduct_type=object
hats_nrows=50
hats_col_ra=RAdeg
hats_col_dec=DEdeg
hats_order=1
hats_npix_suffix=.parquet
hats_version=v0.1
"""
for path, first, count, version in [
    ("hats/dataset/Norder=0/Dir=0/Npix=4.parquet", 0, 30, "1.0"),
    ("hats/dataset/Norder=1/Dir=0/Npix=20/part0.parquet", 30, 20, "2.0"),
]:
    stars = range(first, first + count)
    part = pa.table(
        {
            "_healpix_29": pa.array([i << 40 for i in stars], pa.int64()),
            "source_id": pa.array([(1 << 62) + i for i in stars], pa.int64()),
            "RAdeg": pa.array([7.0 * i for i in stars], pa.float64()),
            "DEdeg": pa.array([i - 25.0 for i in stars], pa.float64()),
            "parallax": pa.array([None if i == 40 else 4.0 for i in stars], pa.float32()),
            "phot_g_mean_mag": pa.array([10 + i % 5 for i in stars], pa.float64()),
        }
    )
    os.makedirs(os.path.dirname(path), exist_ok=True)
    pq.write_table(part, path, compression="zstd", data_page_version=version)
pq.write_metadata(part.schema, "hats/dataset/_common_metadata")
with open("hats/properties", "w") as file:
    file.write(PROPERTIES)

# As `astropy.table.Table.write` does it, by default.
masked = pa.table(
    {
        "id": pa.array([4, (1 << 60) + 1, 6], pa.int64()),
        "id.mask": [False, False, True],
        **{axis: [1.0, 2.0, 3.0] for axis in "xyz"},
        "level": pa.array([7, 99, 9], pa.int16()),
        "level.mask": [False, True, False],
        "own.mask": [True, False, True],
    }
)
yaml = """meta: !!omap
- __serialized_columns__:
    id:
      __class__: astropy.table.column.MaskedColumn
      data: !astropy.table.SerializedColumn {name: id}
      mask: !astropy.table.SerializedColumn {name: id.mask}
    level:
      __class__: astropy.table.column.MaskedColumn
      data: !astropy.table.SerializedColumn {name: level}
      mask: !astropy.table.SerializedColumn {name: level.mask}
"""
pq.write_table(masked.replace_schema_metadata({"table_meta_yaml": yaml}), "masked.parquet")
# The same where nothing is hidden: one without masks.
pq.write_table(masked.drop_columns(["id.mask", "level.mask"]), "unmasked.parquet")
# As many numbers as places have, in lists of which two are longer or shorter, and velocities of which some are missing.
places = [[1.0, 2.0], [3.0, 4.0, 5.0, 6.0]] + [[7.0, 8.0, 9.0 + i] for i in range(4)]
velocities = [[1.0, 2.0, 3.0], [4.0, None, 6.0], None, [], [7.0, 8.0, 9.0], [10.0, 11.0, 12.0]]
ragged = {"pos": pa.array(places), "vel": pa.array(velocities, pa.list_(pa.float32()))}
pq.write_table(pa.table({**ragged, "level": pa.array(places)}), "ragged.parquet")
