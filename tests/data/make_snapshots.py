#!/usr/bin/env python3
"""Writes the small HDF5 snapshots of this folder: python3 make_snapshots.py (needs numpy, h5py and swiftsimio 12).

Each follows the layout that the code of its name documents; the values are random with a fixed seed.
"""
import h5py
import numpy as np
import swiftsimio
import unyt

RNG = np.random.default_rng(7)
COUNT = 96


def swift():
    """A SWIFT initial state of gas and stars by swiftsimio's own writer, compressed, with a kernel named as SWIFT does."""
    units = unyt.UnitSystem("swift", "Mpc", 1e10 * unyt.Msun, 1e9 * unyt.yr)
    box = swiftsimio.cosmo_array([10.0, 10.0, 10.0], "Mpc", comoving=True, scale_factor=0.5, scale_exponent=1)
    writer = swiftsimio.Writer(unit_system=units, boxsize=box, scale_factor=0.5, compress=True)

    def array(values, unit, exponent):
        return swiftsimio.cosmo_array(values, unit, comoving=True, scale_factor=0.5, scale_exponent=exponent)

    for family in (writer.gas, writer.stars):
        family.coordinates = array(RNG.uniform(0, 10, (COUNT, 3)), "Mpc", 1)
        family.velocities = array(RNG.normal(0, 100, (COUNT, 3)), "km/s", 0)
        family.masses = array(RNG.uniform(1, 2, COUNT), 1e10 * unyt.Msun, 0)
        family.smoothing_lengths = array(np.full(COUNT, 0.5), "Mpc", 1)
    writer.gas.internal_energy = array(RNG.uniform(1e4, 2e4, COUNT), "km**2/s**2", -2)
    writer.write("swift.hdf5")
    with h5py.File("swift.hdf5", "a") as file:
        file.create_group("Code").attrs["Code"] = np.bytes_("SWIFT")
        file.create_group("HydroScheme").attrs["Kernel function"] = np.bytes_("Wendland C2")


def header(file, counts, totals, files, table, **more):
    group = file.create_group("Header")
    group.attrs["NumPart_ThisFile"] = np.array(counts, np.int32)
    group.attrs["NumPart_Total"] = np.array(totals, np.uint32)
    group.attrs["NumPart_Total_HighWord"] = np.zeros(6, np.uint32)
    group.attrs["MassTable"] = np.array(table, np.float64)
    group.attrs["NumFilesPerSnapshot"] = np.int32(files)
    for name, value in more.items():
        group.attrs[name] = value


def arepo():
    """An AREPO snapshot in two files, gas in both, dark matter with a mass of the table and tracers in the second one only."""
    for number, (gas, dark) in enumerate([(40, 0), (24, 16)]):
        with h5py.File(f"arepo.{number}.hdf5", "w") as file:
            tracers = 5 * number
            header(file, [gas, dark, 0, tracers, 0, 0], [64, 16, 0, 5, 0, 0], 2, [0, 0.25, 0, 0, 0, 0], Time=0.5, Redshift=1.0,
                   BoxSize=10.0, HubbleParam=0.7, UnitLength_in_cm=3.085678e21, UnitMass_in_g=1.989e43,
                   UnitVelocity_in_cm_per_s=1e5)
            if tracers:
                group = file.create_group("PartType3")
                group["TracerID"] = np.arange(tracers, dtype=np.uint64)
                group["ParentID"] = np.arange(tracers, dtype=np.uint64)
            for kind, count in ((0, gas), (1, dark)):
                if count == 0:
                    continue
                group = file.create_group(f"PartType{kind}")
                first = 1000 * number
                position = group.create_dataset("Coordinates", data=np.arange(first, first + 3 * count).reshape(-1, 3) / 7.0)
                scaling = dict(a_scaling=1.0, h_scaling=-1.0, length_scaling=1.0, mass_scaling=0.0, velocity_scaling=0.0)
                position.attrs.update(scaling, to_cgs=3.085678e21)
                group["ParticleIDs"] = np.arange(first, first + count, dtype=np.uint64)
                group["Velocities"] = RNG.normal(0, 100, (count, 3)).astype(np.float32)
                if kind == 0:
                    group["Masses"] = np.arange(1, count + 1, dtype=np.float32)
                    group["Density"] = RNG.uniform(1, 2, count).astype(np.float32)
                    group["InternalEnergy"] = RNG.uniform(1, 2, count).astype(np.float32)
                    group["GFM_Metallicity"] = RNG.uniform(0, 0.02, count).astype(np.float32)


def eagle():
    """An EAGLE snapshot: units in a group of their own, exponents of a and h at every data set, big-endian numbers."""
    with h5py.File("eagle.hdf5", "w") as file:
        header(file, [COUNT, 0, 0, 0, 0, 0], [COUNT, 0, 0, 0, 0, 0], 1, [0] * 6, Time=1.0, Redshift=0.0, BoxSize=10.0,
               HubbleParam=0.6777, ExpansionFactor=1.0)
        file.create_group("Units").attrs.update(UnitLength_in_cm=3.085678e24, UnitMass_in_g=1.989e43,
                                                UnitVelocity_in_cm_per_s=1e5)
        group = file.create_group("PartType0")
        fields = {"Coordinates": ((COUNT, 3), 1.0, -1.0), "Velocity": ((COUNT, 3), 0.5, 0.0), "Mass": (COUNT, 0.0, -1.0),
                  "SmoothingLength": (COUNT, 1.0, -1.0), "Density": (COUNT, -3.0, 2.0), "Temperature": (COUNT, 0.0, 0.0),
                  "Metallicity": (COUNT, 0.0, 0.0)}
        for name, (shape, a, h) in fields.items():
            data = group.create_dataset(name, data=RNG.uniform(1, 2, shape).astype(">f4"), chunks=True,
                                        compression="gzip", shuffle=True, fletcher32=True)
            data.attrs.update({"aexp-scale-exponent": a, "h-scale-exponent": h, "CGSConversionFactor": 1.0})
        group["ParticleIDs"] = np.arange(COUNT, dtype=np.uint64) + (1 << 40)


def gizmo():
    """A GIZMO snapshot in the newest file format (libver latest), with an array of metallicities."""
    with h5py.File("gizmo.hdf5", "w", libver="latest") as file:
        header(file, [COUNT, 0, 0, 0, 8, 4], [COUNT, 0, 0, 0, 8, 4], 1, [0] * 6, Time=1.0, Redshift=0.0, BoxSize=60000.0,
               HubbleParam=0.7, ComovingIntegrationOn=1, UnitLength_In_CGS=3.085678e21, UnitMass_In_CGS=1.989e43,
               UnitVelocity_In_CGS=1e5)
        for kind, count in ((0, COUNT), (4, 8), (5, 4)):
            group = file.create_group(f"PartType{kind}")
            group.create_dataset("Coordinates", data=RNG.uniform(0, 10, (count, 3)), chunks=(min(count, 7), 3),
                                 maxshape=(None, 3), compression="gzip")
            group["Velocities"] = RNG.normal(0, 100, (count, 3))
            group["Masses"] = RNG.uniform(1, 2, count)
            group["ParticleIDs"] = np.arange(count, dtype=np.uint32)
            if kind == 0:
                group["SmoothingLength"] = RNG.uniform(1, 2, count)
                group["Density"] = RNG.uniform(1, 2, count)
                group["InternalEnergy"] = RNG.uniform(1, 2, count)
                group["Metallicity"] = RNG.uniform(0, 0.02, (count, 11))


def units():
    """Gas whose data sets name their units in words, lengths in two of them."""
    with h5py.File("units.hdf5", "w") as file:
        header(file, [3, 0, 0, 0, 0, 0], [3, 0, 0, 0, 0, 0], 1, [0] * 6, UnitLength_in_cm=3.085678e21)
        group = file.create_group("PartType0")
        for name, values, unit in (("Coordinates", np.arange(9.0).reshape(3, 3), "kpc"), ("SmoothingLength", [1e3, 2e3, 4e3], "ly"),
                                   ("Temperature", [1.0, 2.0, 3.0], "hot"), ("Masses", [1.0, 2.0, 3.0], "")):
            group[name] = np.array(values)
            group[name].attrs["units"] = np.bytes_(unit)


def groups():
    """A group catalogue in the layout of Gadget-4, in three files, of which the last holds nothing."""
    rng = np.random.default_rng(8)
    for number, (count, subhaloes) in enumerate([(3, 2), (2, 0), (0, 0)]):
        with h5py.File(f"groups.{number}.hdf5", "w") as file:
            attrs = file.create_group("Header").attrs
            attrs["NumFiles"] = np.int32(3)
            attrs["BoxSize"] = 10.0
            group, subhalo = file.create_group("Group"), file.create_group("Subhalo")
            if count:
                group["GroupPos"] = rng.uniform(0, 10, (count, 3)).astype(np.float32)
                group["GroupMass"] = np.arange(count, dtype=np.float32) + 1 + 3 * number
                group["Group_R_Crit200"] = np.full(count, 0.25 if number == 0 else 0.0, np.float32)
            if subhaloes:
                subhalo["SubhaloPos"] = rng.uniform(0, 10, (subhaloes, 3)).astype(np.float32)
                subhalo["SubhaloMass"] = np.full(subhaloes, 2.5, np.float32)
                subhalo["SubhaloHalfmassRad"] = np.full(subhaloes, 0.125, np.float32)


def comoving():
    """Dark matter in an expanding universe, at rest: as Gadget-4 and as a run of SWIFT say so. SWIFT computes in other units
    than it writes, Mpc and km/s."""
    units = dict(UnitLength_in_cm=3.085678e24, UnitMass_in_g=1.989e43, UnitVelocity_in_cm_per_s=1e5)
    def dark(file):
        group = file.create_group("PartType1")
        for name in ("Coordinates", "Velocities"):
            group[name] = np.zeros((2, 3), np.float32)
        group["Masses"] = np.ones(2, np.float32)
        return group["Coordinates"].attrs, group["Velocities"].attrs
    with h5py.File("comoving_gadget4.hdf5", "w") as file:
        header(file, [0, 2], [0, 2], 1, [0] * 2, Time=0.25, Redshift=3.0, BoxSize=50.0)
        file.create_group("Parameters").attrs.update(ComovingIntegrationOn=1, Omega0=0.3125, OmegaLambda=0.6875, Hubble=100.0,
                                                     HubbleParam=0.678, **units)
        for attrs, powers in zip(dark(file), ((1.0, -1.0, 1.0, 0.0), (0.5, 0.0, 0.0, 1.0))):
            attrs.update(zip(("a_scaling", "h_scaling", "length_scaling", "velocity_scaling"), powers), mass_scaling=0.0)
    with h5py.File("comoving_swift.hdf5", "w") as file:
        header(file, [0, 2], [0, 2], 1, [0] * 2, BoxSize=[74.0] * 3,
               **{"Time": [0.002], "Redshift": [3.0], "Scale-factor": [0.25]})
        file.create_group("Code").attrs["Code"] = np.bytes_("SWIFT")
        second = 3.08567758149e24 / 1e5
        for name, time in (("Units", second), ("InternalCodeUnits", second / 16)):
            file.create_group(name).attrs.update({"Unit length in cgs (U_L)": [3.08567758149e24],
                                                  "Unit mass in cgs (U_M)": [1.98841e43], "Unit time in cgs (U_t)": [time]})
        file.create_group("Cosmology").attrs.update({"Cosmological run": np.array([1], np.int32), "Omega_m": [0.3125],
                                                     "Omega_lambda": [0.6875], "H0 [internal units]": [67.8 / 16], "h": [0.678],
                                                     "Scale-factor": [0.25], "Redshift": [3.0]})
        for attrs, a, time in zip(dark(file), (1.0, 0.0), (0.0, -1.0)):
            attrs.update({"U_M exponent": [0.0], "U_L exponent": [1.0], "U_t exponent": [time], "a-scale exponent": [a],
                          "h-scale exponent": [0.0]})


def virtual():
    """Files without particles, as SWIFT writes them and SOAP with more data sets: they stand for those of arepo() in a folder `parts`. One is in
    the oldest file format, one in the newest, with more data sets in a group than lie in its header."""
    names = ("Coordinates", "ParticleIDs", "Velocities", "Masses", "Density", "InternalEnergy", "GFM_Metallicity")
    for name, versions, copies in (("virtual.hdf5", "earliest", 0), ("virtual_latest.hdf5", "latest", 3)):
        with h5py.File(name, "w", libver=versions) as file:
            header(file, [64, 16, 0, 0, 0, 0], [64, 16, 0, 0, 0, 0], 1, [0, 0.25, 0, 0, 0, 0], Virtual=np.int32(1))
            for kind, counts, names_of in ((0, (40, 24), names), (1, (0, 16), names[:3])):
                group = file.create_group(f"PartType{kind}")
                for name_of, source in [*zip(names_of, names_of), *((f"Copy{copy}", "Masses") for copy in range(copies) if kind == 0)]:
                    width = (3,) if name_of in ("Coordinates", "Velocities") else ()
                    layout = h5py.VirtualLayout((sum(counts), *width), np.float64)
                    for number, count in enumerate(counts):
                        if count:
                            first = sum(counts[:number])
                            path, inside = f"./parts/arepo.{number}.hdf5", f"PartType{kind}/{source}"
                            layout[first : first + count] = h5py.VirtualSource(path, inside, (count, *width))
                    group.create_virtual_dataset(name_of, layout)


swift()
arepo()
eagle()
gizmo()
units()
groups()
comoving()
virtual()
