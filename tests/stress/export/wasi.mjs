// Runs a WebAssembly program: node wasi.mjs PROGRAM
import { readFileSync } from "fs";
import { WASI } from "wasi";
const wasi = new WASI({ version: "preview1", args: ["test"], env: {} });
const bytes = readFileSync(process.argv[2]);
const { instance } = await WebAssembly.instantiate(bytes, wasi.getImportObject());
process.exitCode = wasi.start(instance);
