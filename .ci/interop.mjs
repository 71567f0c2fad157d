// node interop.mjs GPUGI CHROMIUM SITE [PYTHON]: bakes cornell in each way, opens the files in other programs, and writes a
// table of the root mean square errors of their pictures against gpugi's own. Fails if one is above LIMIT. SITE is a copy of
// examples/load-a-bake with its modules; PYTHON has the package bpy.
import { execFileSync } from 'node:child_process';
import { readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { posted } from './page.mjs';

const [gpugi, chromium, site, python] = process.argv.slice(2);
/// On a scale of 0 to 1 as displayed.
const LIMIT = 0.03;
const SIDE = 128;

const run = (program, ...words) => execFileSync(program, words, { encoding: 'utf8', stdio: ['ignore', 'pipe', 'inherit'] });
const file = (name) => join(site, name);
const version = (name) => JSON.parse(readFileSync(file(`node_modules/${name}/package.json`), 'utf8')).version;
const display = ['--exposure', '0', '--tone-map', 'none'];

function render(scene, picture) {
    const options = ['--technique', 'path-tracer', '--samples', '256', '--size', `${SIDE}x${SIDE}`, ...display];
    run(gpugi, 'render', scene, ...options, '--quiet', '-o', file(picture));
}

const inPage = (page) => async (glb, picture) =>
    writeFileSync(file(picture), await posted(chromium, site, `${page}?file=${glb}&post=${SIDE}x${SIDE}`));

const programs = [
    { name: `three.js ${version('three')}`, show: inPage('three.html') },
    {
        name: `Babylon.js ${version('babylonjs')}`,
        show: inPage('babylon.html'),
        cannot: { lightmap: 'reads no MOZ_lightmap; the emissive bake is its equivalent' },
    },
];
if (python) {
    const script = new URL('blender_picture.py', import.meta.url).pathname;
    programs.push({
        name: `Blender ${run(python, '-c', 'import bpy; print(bpy.app.version_string)').trim()}`,
        show: (glb, picture) => run(python, script, file(glb), file(picture), `${SIDE}`),
    });
}
const outputs = [
    { mode: 'unlit', options: display },
    { mode: 'emissive', options: [] },
    { mode: 'lightmap', options: [] },
];

render('cornell', 'cornell.png');
const rows = [];
let worst = 0;
for (const { mode, options } of outputs) {
    const glb = `${mode}.glb`;
    const bake = ['--bake-mode', mode, '--atlas-size', '128', '--samples', '256', ...options];
    run(gpugi, 'bake', 'cornell', ...bake, '--quiet', '-o', file(glb));
    const cells = [];
    for (const [number, { show, cannot }] of programs.entries()) {
        if (cannot?.[mode]) {
            cells.push(`cannot: ${cannot[mode]}`);
            continue;
        }
        const picture = `${mode}-${number}.png`;
        await show(glb, picture);
        const compared = run(gpugi, 'compare', file(picture), file('cornell.png'), '--metric', 'rmse');
        const error = Number(compared.match(/rmse\s+([\d.e-]+)/)[1]);
        worst = Math.max(worst, error);
        cells.push(error.toFixed(3));
    }
    rows.push(`| ${[`\`--bake-mode ${mode}\``, ...cells].join(' | ')} |`);
}
const names = programs.map(({ name }) => name);
console.log(`| ${['output', ...names].join(' | ')} |\n|${'---|'.repeat(names.length + 1)}\n${rows.join('\n')}`);
if (!(worst <= LIMIT)) {
    console.error(`a picture differs by ${worst}`);
    process.exit(1);
}
process.exit();
