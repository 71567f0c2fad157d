// Renders what the address asks for:
// ?scene=cornell&technique=shadow-map&set=shadow-map.area-samples=8&size=64x64&samples=1
import init, { render } from "./gpugi_web.js";

export async function radiance() {
    await init();
    const asked = new URLSearchParams(location.search);
    const [width, height] = asked.get("size").split("x").map(Number);
    const samples = Number(asked.get("samples"));
    return render(asked.get("scene"), asked.getAll("technique"), asked.getAll("set"), width, height, samples);
}
