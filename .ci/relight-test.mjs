// node relight-test.mjs sky SKY.js FILE.hdr DEGREES: writes the sky of the example, turned about +Y.
// node relight-test.mjs picture CHROMIUM SITE QUERY FILE.hdr: opens the page of SITE, writes the picture that it posts.
import { spawn } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { tmpdir } from 'node:os';
import { extname, join, resolve, sep } from 'node:path';
import { pathToFileURL } from 'node:url';

/// Longest time for the picture (ms).
const PATIENCE = 180_000;

/// Writes RGBA floats, rows from the top, as Radiance HDR.
function writeHdr(path, width, height, data) {
    const pixels = Buffer.alloc(4 * width * height);
    for (let at = 0; at < data.length; at += 4) {
        const rgb = [...data.subarray(at, at + 3)].map((value) => Math.max(value, 0));
        const largest = Math.max(...rgb);
        if (largest > 1e-32) {
            const exponent = Math.floor(Math.log2(largest)) + 1;
            rgb.forEach((value, channel) => {
                pixels[at + channel] = Math.min(Math.round((value * 256) / 2 ** exponent), 255);
            });
            pixels[at + 3] = exponent + 128;
        }
    }
    const header = `#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y ${height} +X ${width}\n`;
    writeFileSync(path, Buffer.concat([Buffer.from(header), pixels]));
}

async function sky(script, path, degrees) {
    const { width, height, data } = (await import(pathToFileURL(resolve(script)))).sky(128);
    const shift = Math.round((width * degrees) / 360);
    const turned = new Float32Array(data.length);
    for (let texel = 0; texel < width * height; texel++) {
        const [row, column] = [Math.floor(texel / width), texel % width];
        const to = row * width + ((column - shift + width) % width);
        turned.set(data.subarray(4 * texel, 4 * texel + 4), 4 * to);
    }
    writeHdr(path, width, height, turned);
}

const TYPES = { '.html': 'text/html; charset=utf-8', '.js': 'text/javascript' };

/// Serves `site`; resolves to what the page posts.
function served(site, open) {
    return new Promise((done, failed) => {
        setTimeout(() => failed(new Error('the browser says nothing')), PATIENCE).unref();
        const root = resolve(site) + sep;
        const server = createServer((request, response) => {
            const path = new URL(request.url, 'http://localhost').pathname;
            if (request.method === 'POST') {
                const parts = [];
                request.on('data', (part) => parts.push(part));
                request.on('end', () => {
                    response.end();
                    const body = Buffer.concat(parts);
                    path === '/picture' ? done(body) : failed(new Error(body.toString()));
                });
                return;
            }
            const file = resolve(join(root, path));
            try {
                const content = readFileSync(file.startsWith(root) ? file : root);
                response.setHeader('Content-Type', TYPES[extname(file)] ?? 'application/octet-stream');
                response.end(content);
            } catch {
                response.statusCode = 404;
                response.end();
            }
        });
        server.listen(0, '127.0.0.1', () => open(`http://127.0.0.1:${server.address().port}`));
    });
}

async function picture(chromium, site, query, path) {
    const [width, height] = new URLSearchParams(query).get('post').split('x').map(Number);
    const profile = mkdtempSync(join(tmpdir(), 'relight-'));
    let browser;
    try {
        const body = await served(site, (address) => {
            browser = spawn(
                chromium,
                [
                    '--headless=new',
                    // It may run as root in a container, and opens nothing but our own page.
                    '--no-sandbox',
                    '--use-angle=swiftshader',
                    '--enable-unsafe-swiftshader',
                    '--disable-background-networking',
                    '--disable-component-update',
                    '--no-first-run',
                    `--user-data-dir=${profile}`,
                    `${address}/index.html?${query}`,
                ],
                { stdio: 'ignore', detached: true },
            );
        });
        const data = new Float32Array(body.buffer.slice(body.byteOffset, body.byteOffset + body.length));
        if (data.length !== 4 * width * height) {
            throw new Error(`${data.length} values are no picture of ${width} x ${height} pixels`);
        }
        const rows = Array.from({ length: height }, (_, row) => data.subarray(4 * width * row, 4 * width * (row + 1)));
        writeHdr(path, width, height, Float32Array.from(rows.reverse().flatMap((row) => [...row])));
    } finally {
        if (browser) {
            const hasEnded = browser.exitCode !== null || browser.signalCode !== null;
            const ended = hasEnded || new Promise((done) => browser.on('exit', done));
            try {
                process.kill(-browser.pid, 'SIGKILL');
            } catch {
                // It has ended by itself.
            }
            await ended;
        }
        rmSync(profile, { recursive: true, force: true, maxRetries: 5 });
    }
}

const [what, ...rest] = process.argv.slice(2);
await (what === 'sky' ? sky(rest[0], rest[1], Number(rest[2])) : picture(...rest));
process.exit();
