// Libraries of others that unpack and read files, as one script: `esbuild` makes `Formats` of it.
import { CompressionType, setCompressionCodec, tableFromIPC, Type } from "@uwdata/flechette";
import { gunzipSync, unzipSync } from "fflate";
import { decompress as unzstd } from "fzstd";
import { parquetMetadata, parquetRead } from "hyparquet";
import { decompress as unlz4 } from "lz4js";
import { decode as unbzip2 } from "seek-bzip";

export { gunzipSync as gunzip, unbzip2, unzstd };

const MOST = 2 ** 31; // bytes that a workbook may unpack to, as in the package

setCompressionCodec(CompressionType.LZ4_FRAME, { decode: unlz4 });
setCompressionCodec(CompressionType.ZSTD, { decode: unzstd });

/** The parts of a zip archive by their names, of those that `wanted` takes. */
export function unzip(bytes, wanted) {
  let size = 0;
  const filter = ({ name, originalSize }) => {
    size += originalSize;
    if (size > MOST) throw new Error(`unpacks to more than ${MOST / 2 ** 20} MiB`);
    return wanted(name);
  };
  return unzipSync(bytes, { filter });
}

const two = (n) => String(n).padStart(2, "0");

/** A time of day from its seconds, as text. */
function ofDay(s) {
  const whole = Math.floor(s + 1e-9);
  const rest = Math.round((s - whole) * 1e6);
  return `${two(Math.floor(whole / 3600))}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}${rest > 0 ? `.${String(rest).padStart(6, "0")}` : ""}`;
}

/** A column: numbers, moments in ms since 1970, or text. `kind` is what the file says of it, `per` its units a second. */
function column(kind, values, per = 1) {
  const numbers = (of) => Float64Array.from(values, (value) => (value === null || value === undefined ? NaN : of(value)));
  if (kind === "numbers") return { kind, cells: numbers(Number) };
  if (kind === "moments") return { kind, cells: numbers((value) => Number(value)) };
  if (kind === "dates") return { kind: "moments", cells: numbers(Number), dates: true };
  const text = kind === "times" ? (value) => ofDay(Number(value) / per) : String;
  return { kind: "text", cells: Array.from(values, (value) => (value === null || value === undefined ? "" : text(value))) };
}

const PER = { MILLIS: 1e3, MICROS: 1e6, NANOS: 1e9 };

/** Names and columns of a Parquet file. */
export async function parquet(bytes) {
  const file = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
  const metadata = parquetMetadata(file);
  const leaves = metadata.schema.slice(1);
  if (leaves.some((leaf) => leaf.num_children)) throw new Error("has columns within columns");
  let rows = [];
  await parquetRead({
    file,
    metadata,
    compressors: { GZIP: (input) => gunzipSync(input), ZSTD: (input) => unzstd(input) },
    parsers: {
      timestampFromMilliseconds: Number,
      timestampFromMicroseconds: (value) => Number(value) / 1e3,
      timestampFromNanoseconds: (value) => Number(value / 1000n) / 1e3,
      dateFromDays: (days) => days * 86_400_000,
    },
    onComplete: (read) => { rows = read; },
  });
  const made = leaves.map(({ type, converted_type: converted, logical_type: logical }, i) => {
    const values = rows.map((row) => row[i]);
    if (logical?.type === "TIME" || converted?.startsWith("TIME_")) {
      return column("times", values, PER[logical?.unit ?? converted.slice(5)]);
    }
    if (logical?.type === "TIMESTAMP" || converted?.startsWith("TIMESTAMP") || type === "INT96") return column("moments", values);
    if (converted === "DATE" || logical?.type === "DATE") return column("dates", values);
    return column(["INT32", "INT64", "FLOAT", "DOUBLE"].includes(type) || converted === "DECIMAL" ? "numbers" : "text", values);
  });
  return { names: leaves.map((leaf) => leaf.name), columns: made };
}

const NUMBERS = [Type.Int, Type.Float, Type.Decimal];

/** Names and columns of an Arrow or Feather file. */
export function arrow(bytes) {
  const table = tableFromIPC(bytes, { useBigInt: true });
  const made = table.schema.fields.map(({ type }, i) => {
    const values = [...table.getChildAt(i)];
    const of = type.typeId === Type.Dictionary ? type.dictionary : type;
    if (of.typeId === Type.Timestamp) return column("moments", values);
    if (of.typeId === Type.Date) return column("dates", values);
    if (of.typeId === Type.Time) return column("times", values, 1000 ** of.unit);
    return column(NUMBERS.includes(of.typeId) ? "numbers" : "text", values);
  });
  return { names: table.schema.fields.map((field) => field.name), columns: made };
}
