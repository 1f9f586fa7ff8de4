#!/usr/bin/env python3
"""Writes the small HDF5, NetCDF, TIFF and tiled FITS files of grids in this folder: python3 make_grids.py (needs numpy, h5py, netCDF4,
tifffile and astropy).

The sample at (x, y, z) of the volumes is x + 10 y + 300 z - 500, as in the other tests of formats.
"""
import h5py
import netCDF4
import numpy as np
import tifffile
from astropy.io import fits

Z, Y, X = np.indices((4, 5, 6))
VOLUME = (X + 10 * Y + 300 * Z - 500).astype("i2")


def hdf5():
    """One volume in a group, in chunks that do not divide it, compressed, big-endian; text and a table beside it."""
    with h5py.File("one.h5", "w", libver="latest") as file:
        data = file.create_dataset("fields/density", data=VOLUME.astype(">i2"), chunks=(3, 4, 5), compression="gzip", shuffle=True)
        data.attrs["units"] = "g/cm^3"
        file["title"] = "a volume"
        file["table"] = np.arange(7)
    with h5py.File("several.h5", "w") as file:
        file["v"] = VOLUME
        file["deep/image"] = VOLUME[0].astype("f8")
        file["deep/loop"] = h5py.SoftLink("/deep")
        file["half"] = VOLUME.astype("f2")
        file["line"] = np.arange(5.0)
        file["five"] = np.zeros((2, 2, 2, 2, 2))
        file["time"] = VOLUME[None].astype("f4")


def netcdf(name, form):
    """A packed field with coordinates at one time, and its bounds, which are no field."""
    with netCDF4.Dataset(name, "w", format=form) as file:
        for axis, count in (("time", None), ("lat", 5), ("lon", 6), ("nv", 2)):
            file.createDimension(axis, count)
        for axis, unit, values in (("lat", "degrees_north", 50 - 0.5 * np.arange(5)), ("lon", "degrees_east", 10 + 0.25 * np.arange(6))):
            variable = file.createVariable(axis, "f4", (axis,))
            variable.units = unit
            variable[:] = values
        file["lat"].bounds = "lat_bounds"
        file.createVariable("lat_bounds", "f4", ("lat", "nv"))[:] = 0
        field = file.createVariable("t2m", "i2", ("time", "lat", "lon"), fill_value=np.int16(-32767))
        field.units, field.scale_factor, field.add_offset = "K", 0.5, 200.0
        field.set_auto_maskandscale(False)
        field[0] = VOLUME[0]
        field[0, 2, 3] = -32767


def tiles():
    """Arrays that are compressed by tiles, of which none divides them; of floats with noise, which is told what it reads as."""
    for name, coding in (("rice", "RICE_1"), ("gzip", "GZIP_1"), ("shuffled", "GZIP_2")):
        hdu = fits.CompImageHDU(VOLUME, compression_type=coding, tile_shape=(3, 2, 4))
        hdu.writeto(f"{name}.fits", overwrite=True)
    field = np.sin(np.arange(1200, dtype="f4") / 37).reshape(30, 40)
    field[3, 4] = np.nan
    fits.CompImageHDU(field, compression_type="RICE_1", quantize_method=1, dither_seed=77).writeto("dither.fits", overwrite=True)
    with fits.open("dither.fits") as file:
        read = file[1].data
    print("dither.fits", [f"{read[y, x]:.9g}" for y, x in ((0, 0), (29, 39), (11, 7))], np.isnan(read[3, 4]))


def tiff():
    """A stack of tiles larger than its pages, in BigTIFF and big-endian; an image with a place and a value for none."""
    tifffile.imwrite("tiles.tif", VOLUME, bigtiff=True, byteorder=">", tile=(16, 16), compression="zlib", photometric="minisblack",
                     metadata=None, software="")
    geo = [(33550, "d", 3, (0.25, 0.5, 0)), (33922, "d", 6, (1, 0, 0, 10, 50, 0)), (42113, "s", 0, "-32767")]
    image = VOLUME[0].copy()
    image[2, 3] = -32767
    tifffile.imwrite("geo.tif", image, extratags=geo, metadata=None, software="")


if __name__ == "__main__":
    tiff()
    tiles()
    hdf5()
    netcdf("field.nc", "NETCDF4")
    netcdf("field3.nc", "NETCDF3_CLASSIC")
    netcdf("field5.nc", "NETCDF3_64BIT_DATA")
    netcdf("field2.nc", "NETCDF3_64BIT_OFFSET")
