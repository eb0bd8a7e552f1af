// Every array of a zarr store over HTTP, read by zarrita: its NaNs, the sum of its finite numbers, its texts.
import * as zarr from "zarrita";

const store = await zarr.withConsolidatedMetadata(new zarr.FetchStore(process.argv[2]));
const root = zarr.root(store);
for (const { path, kind } of store.contents().filter(({ kind }) => kind === "array")) {
  const array = await zarr.open(root.resolve(path), { kind });
  if (array.shape.includes(0)) continue; // zarrita reads none without entries
  const found = await zarr.get(array); // of an array without dimensions its one value
  const values = array.shape.length ? [...found.data] : [found];
  const texts = array.dtype === "string";
  const numbers = texts ? [] : values.map(Number);
  const known = numbers.filter((value) => !Number.isNaN(value));
  const sum = known.filter(Number.isFinite).reduce((a, b) => a + b, 0);
  console.log(JSON.stringify({ path, nan: numbers.length - known.length, sum, texts: texts ? values : [] }));
}
