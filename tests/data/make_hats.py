"""Writes `hats_collection`, a collection of HATS: 60 stars and what is near the edges of their partitions. Needs lsdb. What is in it,
`crates/data/tests/catalogues/parquet.rs` says again."""

import lsdb
import numpy as np
import pandas as pd

rows = np.arange(60)
stars = pd.DataFrame(
    {
        "source_id": rows * 7 + (1 << 60),
        "RAJ2000": 40.0 + (7 * rows % 60) / 2.0,
        "DEJ2000": rows / 2.0 - 15.0,
        "parallax": (4.0 + rows % 5).astype(np.float32),
        "phot_g_mean_mag": 10.0 + 0.125 * rows,
        "name": [f"star {row}" for row in rows],
    }
)
catalogue = lsdb.from_dataframe(
    stars, ra_column="RAJ2000", dec_column="DEJ2000", partition_rows=25, highest_order=2, margin_threshold=7200
)
catalogue.write_catalog(
    "hats_collection", catalog_name="stars", should_write_skymap=False, create_per_partition_statistics=False, progress_bar=False
)
