import { radiance } from "./render.js";

postMessage(await radiance());
