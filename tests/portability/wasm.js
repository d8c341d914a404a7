// Runs a module made of wasm.c and prints its hashes as bits.c does: node wasm.js file.wasm
const module_bytes = require('fs').readFileSync(process.argv[2]);
const hex = (hash) => (hash >>> 0).toString(16).padStart(8, '0');

WebAssembly.instantiate(module_bytes).then(({ instance: { exports } }) => {
    if (exports.bits_failed()) {
        console.log('a build failed');
        process.exit(1);
    }
    console.log(hex(exports.bits_memory()), hex(exports.bits_values()));
});
