/* check_wgsl.mjs: envsamp.wgsl compiled, and run beside C, by Dawn: npm install webgpu.
 *
 *     node check_wgsl.mjs check.wgsl              compiles envsamp.wgsl; no device is needed
 *     gpu_check -n 100000 -d cases sky            writes what C draws into a folder
 *     EGL_PLATFORM=surfaceless node check_wgsl.mjs check.wgsl cases
 *
 * check.wgsl is what translate.pl makes of check.glsl. A line a case says how many points differ in
 * their block, in direction by more than 1e-5, in density by more than 1e-5 relative, and in any
 * bit. Exits with 1 if the text does not compile, or more than one block in 10000 differs: WGSL has
 * no `precise`; with 2 where Dawn finds no device.
 */
import { readFileSync, readdirSync } from 'node:fs';
import { createRequire } from 'node:module';
import { pathToFileURL } from 'node:url';
import path from 'node:path';

const { create, globals } = await import(pathToFileURL(
    createRequire(path.resolve('package.json')).resolve('webgpu')).href);
Object.assign(globalThis, globals);
const [checkPath, folder] = process.argv.slice(2);
const here = path.dirname(new URL(import.meta.url).pathname);
const library = readFileSync(path.join(here, 'envsamp.wgsl'), 'utf8');
const check = readFileSync(checkPath, 'utf8');
const modes = 8, resultWords = 8, tolerance = 1e-5;

async function open(backend) {
    const gpu = create(['backend=' + backend]);
    const adapter = await gpu.requestAdapter({ featureLevel: 'compatibility' });

    return adapter && { gpu, device: await adapter.requestDevice({ requiredLimits: {
        maxStorageBufferBindingSize: adapter.limits.maxStorageBufferBindingSize,
        maxBufferSize: adapter.limits.maxBufferSize } }) };
}

async function compile(device, mode) {
    device.pushErrorScope('validation');
    const module = device.createShaderModule({
        code: `const CHECK_MODE: u32 = ${mode}u;\n${library}\n${check}` });
    const { messages } = await module.getCompilationInfo();
    const error = await device.popErrorScope();

    for (const m of messages)
        console.log(`envsamp.wgsl: mode ${mode}, line ${m.lineNum}: ${m.type}: ${m.message}`);
    return error ? null : module;
}

function buffer(device, words, usage) {
    const made = device.createBuffer({ size: words.byteLength,
                                       usage: usage | GPUBufferUsage.COPY_DST });

    device.queue.writeBuffer(made, 0, words);
    return made;
}

/* A case: mode, points, words of the table, seed; the table, directions, and what C draws. */
async function run(device, module, words) {
    const [, points, tableWords, seed] = words;
    const dirs = 4 + tableWords, wanted = dirs + 3 * points, bytes = 4 * resultWords * points;
    const pipeline = device.createComputePipeline({ layout: 'auto', compute: { module } });
    const table = buffer(device, words.slice(4, dirs), GPUBufferUsage.STORAGE);
    const directions = buffer(device, words.slice(dirs, wanted), GPUBufferUsage.STORAGE);
    const results = buffer(device, new Uint32Array(resultWords * points),
                           GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_SRC);
    const settings = buffer(device, new Uint32Array([seed, points]), GPUBufferUsage.STORAGE);
    const back = device.createBuffer({ size: bytes,
                                       usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
    const entries = [table, directions, results, settings].map(
        (b, binding) => ({ binding, resource: { buffer: b } }));
    const encoder = device.createCommandEncoder(), pass = encoder.beginComputePass();

    pass.setPipeline(pipeline);
    pass.setBindGroup(0, device.createBindGroup({ layout: pipeline.getBindGroupLayout(0),
                                                  entries }));
    pass.dispatchWorkgroups(Math.ceil(points / 64));
    pass.end();
    encoder.copyBufferToBuffer(results, 0, back, 0, bytes);
    device.queue.submit([encoder.finish()]);
    await back.mapAsync(GPUMapMode.READ);
    const got = new Uint32Array(back.getMappedRange().slice(0));
    for (const b of [table, directions, results, settings, back])
        b.destroy();
    return [got, words.slice(wanted)];
}

function compare(got, wanted) {
    const a = new Float32Array(got.buffer), b = new Float32Array(wanted.buffer);
    const sum = { points: got.length / resultWords, blocks: 0, dirs: 0, pdfs: 0, bits: 0 };

    for (let i = 0; i < got.length; i += resultWords) {
        const differ = [0, 1, 2, 3, 4, 5].some(k => got[i + k] !== wanted[i + k]);
        const near = [0, 1, 2].every(k => Math.abs(a[i + k] - b[i + k]) <= tolerance);
        const most = Math.max(a[i + 3], b[i + 3]);

        if (got[i + 6] !== wanted[i + 6]) {
            sum.blocks++;
            continue;
        }
        sum.bits += differ;
        sum.dirs += !near;
        sum.pdfs += !(Math.abs(a[i + 3] - b[i + 3]) <= tolerance * most);
    }
    return sum;
}

async function main() {
    const opened = await open(folder ? 'opengles' : 'null');
    const modules = [];
    let failures = 0;

    if (!opened) {
        console.log('Dawn finds no device');
        return 2;
    }
    const { device } = opened;
    for (let mode = 0; mode < modes; mode++)
        modules.push(await compile(device, mode));
    if (modules.includes(null))
        return 1;
    for (const file of folder ? readdirSync(folder).filter(f => f.endsWith('.case')).sort() : []) {
        const bytes = readFileSync(path.join(folder, file));
        const words = new Uint32Array(bytes.buffer.slice(bytes.byteOffset,
                                                         bytes.byteOffset + bytes.byteLength));
        const sum = compare(...await run(device, modules[words[0]], words));

        console.log(`${file.replace('.case', '').padEnd(40)} ${sum.points} points: ${sum.blocks} `
                    + `blocks, ${sum.dirs} dirs, ${sum.pdfs} pdfs, ${sum.bits} bits differ`);
        failures += sum.blocks > 1e-4 * sum.points;
    }
    device.destroy();
    return failures > 0 ? 1 : 0;
}

process.exit(await main());
