// Does one job of the page, in an instance of its WebAssembly.
import init, { work } from "./gpugi_web.js";

onmessage = async ({ data: { module, name, job } }) => {
    try {
        await init({ module_or_path: module });
    } catch (error) {
        // Without this, the page would hear nothing.
        reportError(error);
        return;
    }
    postMessage(0);
    let result;
    try {
        result = work(name, job);
    } catch (error) {
        console.error(error);
    }
    postMessage({ result }, result ? [result.buffer] : []);
};
