import { LinearSRGBColorSpace } from 'three';

/// A plugin of three.js's GLTFLoader that reads lightmaps (MOZ_lightmap), of `gpugi bake --bake-mode lightmap`:
///
///     new GLTFLoader().register((parser) => new Lightmaps(parser))
///
/// Texels hold irradiance in linear 8 bits, in units of `intensity`.
export class Lightmaps {
    name = 'MOZ_lightmap';

    constructor(parser) {
        this.parser = parser;
    }

    extendMaterialParams(materialIndex, parameters) {
        const lightmap = this.parser.json.materials[materialIndex].extensions?.[this.name];
        if (!lightmap) {
            return Promise.resolve();
        }
        parameters.lightMapIntensity = lightmap.intensity ?? 1;
        const { index, texCoord = 1 } = lightmap;
        return this.parser.assignTexture(parameters, 'lightMap', { index, texCoord }, LinearSRGBColorSpace);
    }
}
