"""Every array of a zarr store, read by one library: NaNs, the sum of finite numbers, texts; a line of JSON each.

Run by versions.py in an environment that has nothing but that library.
"""

import json
import sys
from pathlib import Path


def arrays_of(store):
    """Return the paths of all arrays of a zarr v3 store, and which are text."""
    for file in sorted(Path(store).rglob("zarr.json")):
        about = json.loads(file.read_text())
        if about["node_type"] == "array":
            yield file.parent.relative_to(store).as_posix(), about["data_type"] == "string"


def say(path, values, text):
    """Print what an array holds."""
    import numpy

    values = numpy.asarray(values)
    if text:
        found = {"nan": 0, "sum": 0.0, "texts": [str(each) for each in values.ravel().tolist()]}
    else:
        numbers = values.astype(float)
        finite = numbers[numpy.isfinite(numbers)]
        found = {"nan": int(numpy.isnan(numbers).sum()), "sum": float(finite.sum()), "texts": []}
    print(json.dumps({"path": path, **found}))


def by_xarray(store):
    """Groups by groups, as `xarray.open_zarr` does."""
    import xarray

    groups = sorted({path.rpartition("/")[0] for path, _ in arrays_of(store)})
    texts = dict(arrays_of(store))
    for group in groups:
        with xarray.open_zarr(store, group=group or None, chunks=None) as found:
            for name, values in found.variables.items():
                path = f"{group}/{name}".strip("/")
                say(path, values.values, texts[path])


def by_zarr(store):
    """Array by array."""
    import zarr

    root = zarr.open_group(store, mode="r")
    for path, text in arrays_of(store):
        say(path, root[path][...], text)


def by_tensorstore(store):
    """Array by array. It knows no text of zarr, so texts are read from the attribute that repeats them."""
    import tensorstore

    for path, text in arrays_of(store):
        array = {"driver": "zarr3", "kvstore": {"driver": "file", "path": f"{store}/{path}/"}}
        file = {"driver": "file", "path": f"{store}/{path}/zarr.json"}
        attribute = {"driver": "json", "kvstore": file, "json_pointer": "/attributes/texts"}
        found = tensorstore.open(attribute if text else array, open=True, read=True).result().read().result()
        say(path, json.loads(found.item()) if text else found, text)


def by_gdal(store):
    """Array by array, numbers only."""
    import rasterio

    for path, text in arrays_of(store):
        if not text:
            with rasterio.open(f'ZARR:"{store}":/{path}') as found:
                say(path, found.read(), text)


def by_gdal_netcdf(store):
    """The maps of the survey as NetCDF: GDAL reads rasters only."""
    import rasterio

    for path, text in arrays_of(store):
        about = json.loads(Path(store, path, "zarr.json").read_text())
        if not text and "/" not in path and about.get("dimension_names", [])[-2:] == ["epsilon", "delta"]:
            with rasterio.open(f'netcdf:"{Path(store).with_suffix(".nc")}":{path}') as found:
                say(path, found.read(), text)


def by_icechunk(store):
    """Written to a repository by xarray, and read from it."""
    import tempfile

    import icechunk
    import xarray

    texts = dict(arrays_of(store))
    with tempfile.TemporaryDirectory() as directory, xarray.open_zarr(store, chunks=None) as found:
        repository = icechunk.Repository.create(icechunk.local_filesystem_storage(directory))
        session = repository.writable_session("main")
        found.drop_encoding().to_zarr(session.store, zarr_format=3, consolidated=False)
        session.commit("a survey")
        kept = xarray.open_zarr(repository.readonly_session("main").store, consolidated=False, chunks=None)
        for name, values in kept.variables.items():
            say(name, values.values, texts[name])


def by_virtualizarr(store):
    """References to the chunks of a survey as NetCDF, which are loaded from there."""
    from obspec_utils.registry import ObjectStoreRegistry
    from obstore.store import LocalStore
    from virtualizarr import open_virtual_dataset
    from virtualizarr.parsers import HDFParser

    texts = dict(arrays_of(store))
    file = str(Path(store).with_suffix(".nc").resolve())
    registry = ObjectStoreRegistry({"file://": LocalStore()})
    numbers = [name for name, text in texts.items() if "/" not in name and not text]
    found = open_virtual_dataset(f"file://{file}", registry=registry, parser=HDFParser(), loadable_variables=numbers)
    for name in numbers:
        say(name, found[name].values, False)


if __name__ == "__main__":
    globals()[f"by_{sys.argv[1]}"](sys.argv[2])
