"""Writes `hbt.0.hdf5`, `hbt.1.hdf5` and `velociraptor.hdf5`: five haloes in the layouts of HBT+ (records, in two files, of which the second is
big-endian) and of VELOCIraptor (columns of the root). Needs h5py. What is in them, `tests/processor/explore/halo_catalogues.rs` says again."""

import h5py
import numpy as np


def hbt():
    for number, tracks in enumerate(([0, 1, 2], [3, 4])):
        order = "<>"[number]
        records = np.zeros(len(tracks), [("TrackId", order + "i8"), ("Nbound", order + "i4"), ("Mbound", order + "f4"),
                                         ("ComovingMostBoundPosition", order + "f8", 3), ("RHalfComoving", order + "f4")])
        for record, k in zip(records, tracks):
            record["TrackId"], record["Nbound"], record["Mbound"] = k, 100 - k, 2.0 + k
            record["ComovingMostBoundPosition"], record["RHalfComoving"] = (k + 0.5, 2 * k, 10 - k), 0.125 * (k + 1)
        with h5py.File(f"hbt.{number}.hdf5", "w") as file:
            file["Subhalos"] = records
            file["NumberOfFiles"] = np.array([2], np.int32)
            file["Units/LengthInMpch"] = np.array([1.0])
            file["Units/MassInMsunh"] = np.array([1e10])


def velociraptor():
    k = np.arange(5)
    with h5py.File("velociraptor.hdf5", "w") as file:
        file["ID"] = (k + 1).astype(np.uint64)
        file["Xc"], file["Yc"], file["Zc"] = k + 0.5, 2.0 * k, 10.0 - k
        file["Mass_200crit"], file["R_200crit"] = 2.0 + k, 0.125 * (k + 1)
        attrs = file.create_group("UnitInfo").attrs
        attrs["Length_unit_to_kpc"], attrs["Mass_unit_to_solarmass"] = 1000.0, np.bytes_("1e10")
        attrs["Comoving_or_Physical"] = np.bytes_("0")


hbt()
velociraptor()
