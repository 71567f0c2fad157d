// Transfer vectors in a file of `gpugi bake --technique radiance-transfer`, and materials that multiply them by light.
import * as THREE from 'three';

const VK_FORMAT_R16G16B16A16_SFLOAT = 97;
const VK_FORMAT_R8G8B8A8_SNORM = 38;

/// What extras.gpugi.radianceTransfer of a loaded file says, with its pages as array textures.
export async function loadTransfer(gltf) {
    const extras = gltf.userData.gpugi?.radianceTransfer;
    if (extras?.version !== 1 || extras.basis !== 'spherical harmonics') {
        throw new Error('the file has no transfer vectors: bake it with --technique radiance-transfer');
    }
    const views = extras.pages.map((page) => gltf.parser.getDependency('bufferView', page.bufferView));
    return { ...extras, textures: (await Promise.all(views)).map(arrayTexture) };
}

/// The texture in an uncompressed KTX2 file.
function arrayTexture(bytes) {
    const header = new DataView(bytes);
    const word = (at) => header.getUint32(at, true);
    const [format, width, height, layers] = [word(12), word(20), word(24), word(32)];
    const [offset, length] = [word(80), word(88)];
    let texture;
    if (format === VK_FORMAT_R16G16B16A16_SFLOAT) {
        const data = new Uint16Array(bytes.slice(offset, offset + length));
        texture = new THREE.DataArrayTexture(data, width, height, layers);
        texture.type = THREE.HalfFloatType;
    } else if (format === VK_FORMAT_R8G8B8A8_SNORM) {
        const data = new Int8Array(bytes.slice(offset, offset + length));
        texture = new THREE.DataArrayTexture(data, width, height, layers);
        texture.type = THREE.ByteType;
        texture.internalFormat = 'RGBA8_SNORM';
    } else {
        throw new Error(`VkFormat ${format} is not read`);
    }
    texture.minFilter = texture.magFilter = THREE.LinearFilter;
    texture.needsUpdate = true;
    return texture;
}

/// The uniform `light`: L_m, times the scale of 8-bit coefficients. Set it with `setLight`.
export function lightUniform(transfer) {
    return { value: Array.from({ length: transfer.order ** 2 }, () => new THREE.Vector3()) };
}

export function setLight(uniform, transfer, light) {
    light.forEach((rgb, m) => uniform.value[m].fromArray(rgb).multiplyScalar(transfer.scale?.[m] ?? 1));
}

/// Makes a mesh of the file reflect the light diffusely:
///     L_out = albedo / pi E + emitted,    E = pi sum of T_m L_m
export function relight(mesh, transfer, light) {
    const original = mesh.material;
    const place = original.userData.gpugi?.radianceTransfer;
    if (!place) {
        return;
    }
    const set = place.texCoord === 0 ? 'uv' : `uv${place.texCoord}`;
    mesh.geometry.setAttribute('atlas', mesh.geometry.attributes[set]);
    const color = original.color.clone().multiplyScalar(1 - (original.metalness ?? 0));
    const { map, alphaMap, alphaTest, transparent, opacity, side, vertexColors } = original;
    const material = new THREE.MeshBasicMaterial({
        color, map, alphaMap, alphaTest, transparent, opacity, side, vertexColors,
    });
    const emitted = original.emissive?.clone().multiplyScalar(original.emissiveIntensity) ?? new THREE.Color(0);
    material.onBeforeCompile = (shader) => {
        Object.assign(shader.uniforms, {
            light,
            transfer: { value: transfer.textures[place.page] },
            emitted: { value: emitted },
        });
        shader.vertexShader = shader.vertexShader
            .replace('#include <common>', '#include <common>\nattribute vec2 atlas;\nvarying vec2 texel;')
            .replace('#include <begin_vertex>', '#include <begin_vertex>\ntexel = atlas;');
        shader.fragmentShader = shader.fragmentShader
            .replace(
                '#include <common>',
                `#include <common>
                precision highp sampler2DArray;
                uniform sampler2DArray transfer;
                uniform vec3 light[${transfer.order ** 2}];
                uniform vec3 emitted;
                varying vec2 texel;`,
            )
            .replace(
                '#include <envmap_fragment>',
                `vec3 sum = vec3(0.0);
                for (int m = 0; m < ${transfer.order ** 2}; m++) {
                    sum += textureLod(transfer, vec3(texel, float(m)), 0.0).rgb * light[m];
                }
                // Texels lie on fronts.
                vec3 reflected = gl_FrontFacing ? max(sum, vec3(0.0)) : vec3(0.0);
                outgoingLight = outgoingLight * reflected + emitted;`,
            );
    };
    mesh.material = material;
}
