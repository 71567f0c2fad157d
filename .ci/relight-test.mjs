// node relight-test.mjs sky SKY.js FILE.hdr DEGREES: writes the sky of the example, turned about +Y.
// node relight-test.mjs picture CHROMIUM SITE QUERY FILE.hdr: opens the page of SITE, writes the picture that it posts.
import { writeFileSync } from 'node:fs';
import { resolve } from 'node:path';
import { pathToFileURL } from 'node:url';
import { posted } from './page.mjs';

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

async function picture(chromium, site, query, path) {
    const [width, height] = new URLSearchParams(query).get('post').split('x').map(Number);
    const body = await posted(chromium, site, `index.html?${query}`);
    const data = new Float32Array(body.buffer.slice(body.byteOffset, body.byteOffset + body.length));
    if (data.length !== 4 * width * height) {
        throw new Error(`${data.length} values are no picture of ${width} x ${height} pixels`);
    }
    const rows = Array.from({ length: height }, (_, row) => data.subarray(4 * width * row, 4 * width * (row + 1)));
    writeHdr(path, width, height, Float32Array.from(rows.reverse().flatMap((row) => [...row])));
}

const [what, ...rest] = process.argv.slice(2);
await (what === 'sky' ? sky(rest[0], rest[1], Number(rest[2])) : picture(...rest));
process.exit();
