// Judges .glb files with the Khronos validator: node validate-gltf.mjs FOLDER, in a folder where npm has installed gltf-validator.
// Errors fail. Files beside are not looked for: tests refer to some that do not exist.
import { createRequire } from 'node:module';
import { readdirSync, readFileSync } from 'node:fs';
import { join } from 'node:path';

const { validateBytes } = createRequire(join(process.cwd(), 'here.js'))('gltf-validator');
const folder = process.argv[2];
const names = readdirSync(folder).filter((name) => name.endsWith('.glb'));
let errors = 0;
for (const name of names) {
    const report = await validateBytes(new Uint8Array(readFileSync(join(folder, name))));
    for (const { severity, code, pointer, message } of report.issues.messages) {
        if (severity === 0 && code !== 'IO_ERROR') {
            console.error(`${name}: ${pointer ?? ''}: ${code}: ${message}`);
            errors += 1;
        }
    }
}
console.log(`${names.length} files, ${errors} errors`);
process.exit(names.length > 0 && errors === 0 ? 0 : 1);
