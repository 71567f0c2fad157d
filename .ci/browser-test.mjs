// Drives the viewer's page in headless Chromium, on its software adapter, in a folder where npm has installed
// puppeteer-core: node browser-test.mjs CHROMIUM FOLDER SERVER ARGUMENTS...
// Writes FOLDER/SHOT.exr, what the page shows, and FOLDER/SHOT.command, the command line that renders the same.
import { spawn } from 'node:child_process';
import { writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';
import { createInterface } from 'node:readline';

const puppeteer = createRequire(join(process.cwd(), 'here.js'))('puppeteer-core');
const [chromium, folder, program, ...programArguments] = process.argv.slice(2);

/// Longest time for a picture (ms).
const PATIENCE = 60_000;

function check(isRight, what) {
    if (!isRight) {
        throw new Error(what);
    }
}

/// A .glb of one mesh.
function glb(corners, triangles) {
    const positions = Buffer.from(new Float32Array(corners).buffer);
    const indices = Buffer.from(new Uint32Array(triangles).buffer);
    const side = (pick, axis) => corners.filter((_, at) => at % 3 === axis).reduce((a, b) => pick(a, b));
    const [min, max] = [Math.min, Math.max].map((pick) => [0, 1, 2].map((axis) => Math.fround(side(pick, axis))));
    const document = {
        asset: { version: '2.0' },
        scenes: [{ nodes: [0] }],
        nodes: [{ mesh: 0 }],
        meshes: [{ primitives: [{ attributes: { POSITION: 0 }, indices: 1 }] }],
        accessors: [
            { bufferView: 0, componentType: 5126, count: corners.length / 3, type: 'VEC3', min, max },
            { bufferView: 1, componentType: 5125, count: triangles.length, type: 'SCALAR' },
        ],
        bufferViews: [
            { buffer: 0, byteLength: positions.length },
            { buffer: 0, byteOffset: positions.length, byteLength: indices.length },
        ],
        buffers: [{ byteLength: positions.length + indices.length }],
    };
    const chunk = (kind, content, padding) => {
        const padded = Buffer.concat([content, Buffer.alloc(-content.length & 3, padding)]);
        const head = Buffer.alloc(8);
        head.writeUInt32LE(padded.length, 0);
        head.write(kind, 4);
        return Buffer.concat([head, padded]);
    };
    const chunks = [
        chunk('JSON', Buffer.from(JSON.stringify(document)), ' '),
        chunk('BIN\0', Buffer.concat([positions, indices]), 0),
    ];
    const head = Buffer.from('glTF\x02\0\0\0\0\0\0\0');
    head.writeUInt32LE(12 + chunks[0].length + chunks[1].length, 8);
    return Buffer.concat([head, ...chunks]);
}

/// A box without lid, seen from above.
function box() {
    const corners = [-1, 0, -1, 1, 0, -1, 1, 0, 1, -1, 0, 1, -1, 1, -1, 1, 1, -1];
    return glb(corners, [0, 2, 1, 0, 3, 2, 0, 1, 5, 0, 5, 4]);
}

/// A landscape with so many triangles that it takes seconds to unwrap.
function hills() {
    const SIDE = 100;
    const [corners, triangles] = [[], []];
    for (let z = 0; z <= SIDE; z += 1) {
        for (let x = 0; x <= SIDE; x += 1) {
            corners.push(x / SIDE, Math.sin(x / 5) * Math.sin(z / 7) / 10, z / SIDE);
            const at = z * (SIDE + 1) + x;
            if (x < SIDE && z < SIDE) {
                triangles.push(at, at + SIDE + 1, at + 1, at + 1, at + SIDE + 1, at + SIDE + 2);
            }
        }
    }
    return glb(corners, triangles);
}

/// In the page: keeps the jobs that it gives to workers, with the frames in which they were at work.
function watchWorkers() {
    window.jobs = [];
    window.Worker = class extends Worker {
        postMessage(message, transfer) {
            const job = { name: message.name, frames: 0, hasEnded: false, hasResult: false };
            const count = () => {
                if (!job.hasEnded) {
                    job.frames += 1;
                    requestAnimationFrame(count);
                }
            };
            requestAnimationFrame(count);
            window.jobs.push(job);
            this.job = job;
            this.addEventListener('message', ({ data }) => (job.hasResult ||= !!data.result));
            super.postMessage(message, transfer);
        }

        terminate() {
            this.job.hasEnded = true;
            super.terminate();
        }
    };
}

const complaints = [];

/// Opens a page, once more if the browser's GPU process has crashed on the way: the browser starts it anew.
async function open(browser, url) {
    try {
        return await openOnce(browser, url);
    } catch (error) {
        if (!error.message.includes('finds no GPU')) {
            throw error;
        }
        console.log('the browser lost its GPU; once more');
        complaints.length = 0;
        return openOnce(browser, url);
    }
}

async function openOnce(browser, url) {
    const page = await browser.newPage();
    page.on('console', (message) => {
        if (['error', 'warn'].includes(message.type())) {
            complaints.push(message.text());
        }
    });
    page.on('pageerror', (error) => complaints.push(error.message));
    page.setDefaultTimeout(PATIENCE);
    await page.evaluateOnNewDocument(watchWorkers);
    await page.goto(url);
    await page.waitForFunction(() => window.gpugi || !document.getElementById('words').textContent.includes('way'));
    check(await page.evaluate(() => !!window.gpugi), await page.evaluate(() => document.body.innerText));
    return page;
}

/// Waits until the picture is complete and the page's command matches `expected`; returns the command.
async function settled(page, expected) {
    const deadline = Date.now() + PATIENCE;
    let command = '';
    while (Date.now() < deadline) {
        await new Promise((done) => setTimeout(done, 100));
        if (await page.evaluate(() => window.gpugi.isComplete())) {
            command = await page.evaluate(() => window.gpugi.command());
            if (expected.test(command)) {
                return command;
            }
        }
    }
    throw new Error(`${expected} does not come; the page shows: ${command}`);
}

/// Waits until the path tracer has samples. Chromium's software adapter takes half a minute for the first.
function traced(page, samples) {
    const has = (samples) => window.gpugi.tracedSamples() >= samples;
    return page.waitForFunction(has, { timeout: 4 * PATIENCE }, samples);
}

/// Longest time between two of the next frames (ms).
function slowestFrame(page) {
    return page.evaluate(async () => {
        const frame = () => new Promise(requestAnimationFrame);
        let [last, slowest] = [await frame(), 0];
        for (let count = 0; count < 20; count += 1) {
            const now = await frame();
            slowest = Math.max(slowest, now - last);
            last = now;
        }
        return slowest;
    });
}

/// Drops a file on the page.
async function drop(page, name, bytes) {
    writeFileSync(join(folder, name), bytes);
    await page.evaluate((name, bytes) => {
        const transfer = new DataTransfer();
        transfer.items.add(new File([new Uint8Array(bytes)], name));
        const canvas = document.querySelector('canvas');
        canvas.dispatchEvent(new DragEvent('drop', { dataTransfer: transfer, bubbles: true, cancelable: true }));
    }, name, Array.from(bytes));
}

/// Waits until a worker has done the page's last job of this name, and checks that the page did not stand still.
async function worked(page, name) {
    const last = (name) => window.jobs.findLast((job) => job.name === name);
    await page.waitForFunction(`(${last})(${JSON.stringify(name)})?.hasEnded`);
    const { frames, hasResult } = await page.evaluate(last, name);
    console.log(`frames while a worker had to ${name}: ${frames}`);
    check(hasResult, `no worker can ${name}`);
    check(frames >= 3, `the page stands still while a worker has to ${name}`);
}

async function shoot(page, name, expected) {
    const command = await settled(page, expected);
    const bytes = await page.evaluate(async () => Array.from(await window.gpugi.exr()));
    writeFileSync(join(folder, `${name}.exr`), Buffer.from(bytes));
    writeFileSync(join(folder, `${name}.command`), command);
}

const server = spawn(program, programArguments, { stdio: ['ignore', 'pipe', 'inherit'] });
let browser;
try {
    const [address] = await new Promise((done, failed) => {
        createInterface(server.stdout).once('line', (line) => done(line.split('#')));
        server.once('exit', () => failed(new Error('the server ends')));
    });
    browser = await puppeteer.launch({
        executablePath: chromium,
        defaultViewport: { width: 420, height: 180 },
        // It may run as root in a container, and opens nothing but our own page.
        // Without a software Vulkan for its own drawing, Chromium loses the device when the canvas is shown.
        args: [
            '--no-sandbox',
            '--enable-unsafe-webgpu',
            '--use-webgpu-adapter=swiftshader',
            '--enable-features=Vulkan',
            '--use-vulkan=swiftshader',
            '--use-angle=vulkan',
            '--disable-vulkan-surface',
        ],
    });

    // Nothing lights the scene, until a technique does.
    const page = await open(browser, `${address}#scene=cornell&technique=none&set=shadow-map.area-samples=8&samples=2`);
    await settled(page, /--technique none /);
    await page.evaluate(() => window.gpugi.run('technique shadow-map'));
    await shoot(page, 'cornell', /render cornell .*--technique shadow-map /);

    await page.mouse.move(360, 60);
    await page.mouse.down();
    await page.mouse.move(380, 70, { steps: 4 });
    await page.mouse.up();
    await shoot(page, 'orbited', /--camera 'eye=.*--technique shadow-map /);

    await page.waitForFunction(() => /camera=eye.*technique=shadow-map/.test(location.hash));
    const seen = await page.evaluate(() => location.href);
    await page.evaluate(() => window.gpugi.run('lose-device'));
    await page.waitForFunction(() => document.body.innerText.includes('lost the GPU'));
    await Promise.all([page.waitForNavigation(), page.click('button')]);
    check(page.url() === seen, `the page that is loaded again shows ${page.url()} in place of ${seen}`);
    await page.waitForFunction(() => window.gpugi);

    const again = await open(browser, seen);
    await shoot(again, 'again', /--camera 'eye=.*--technique shadow-map /);

    await drop(again, 'box.glb', box());
    await settled(again, /render box\.glb /);
    await again.evaluate(() => window.gpugi.run('technique shadow-map,image-based-lighting'));
    await shoot(again, 'dropped', /render box\.glb .*image-based-lighting /);

    // Where no worker starts, the page does it.
    const alone = await browser.newPage();
    await alone.setRequestInterception(true);
    const isWorker = (request) => new URL(request.url()).pathname === '/worker.js';
    alone.on('request', (request) => (isWorker(request) ? request.abort() : request.continue()));
    await alone.goto(`${address}#scene=cornell&technique=shadow-map&samples=2`);
    await alone.waitForFunction(() => window.gpugi);
    await shoot(alone, 'alone', /render cornell .*--technique shadow-map /);
    await alone.close();

    // What takes long is done by workers, and frames go on.
    await drop(again, 'hills.glb', hills());
    await settled(again, /render hills\.glb /);
    await again.evaluate(() => window.gpugi.run('technique shadow-map,radiosity'));
    await worked(again, 'lay out an atlas');

    // The path tracer, alone and beside the picture. Frames go on while it works.
    await again.evaluate(() => window.gpugi.open('scene=cornell&technique=path-tracer&samples=1'));
    await traced(again, 1);
    const slowest = await slowestFrame(again);
    console.log(`slowest frame beside the path tracer: ${slowest.toFixed(0)} ms`);
    check(slowest < 500, 'the path tracer blocks the page');
    await shoot(again, 'traced', /render cornell .*--technique path-tracer --samples 1 /);
    await again.evaluate(() => window.gpugi.open('scene=cornell&technique=shadow-map&samples=2'));
    await settled(again, /--technique shadow-map .*--samples 2 /);
    check(await again.evaluate(() => window.gpugi.tracedSamples()) === 0, 'a picture alone is traced');
    await again.keyboard.press('t');
    await traced(again, 1);

    check(complaints.length === 0, `the console says:\n${complaints.join('\n')}`);
} catch (error) {
    console.error(complaints.join('\n'));
    throw error;
} finally {
    await browser?.close();
    server.kill();
}
