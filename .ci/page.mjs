// What a page posts, for tests.
import { spawn } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { createServer } from 'node:http';
import { tmpdir } from 'node:os';
import { extname, join, resolve, sep } from 'node:path';

/// Longest time for a picture (ms).
const PATIENCE = 180_000;

const TYPES = { '.html': 'text/html; charset=utf-8', '.js': 'text/javascript', '.css': 'text/css' };

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

/// Opens a page of the folder `site` in headless Chromium; resolves to the picture that it posts.
export async function posted(chromium, site, page) {
    const profile = mkdtempSync(join(tmpdir(), 'page-'));
    let browser;
    try {
        return await served(site, (address) => {
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
                    `${address}/${page}`,
                ],
                { stdio: 'ignore', detached: true },
            );
        });
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
