// The environment: read from a file or made, and shown behind the scene.
import * as THREE from 'three';
import { HDRLoader } from 'three/addons/loaders/HDRLoader.js';
import { sky } from './sky.js';

/// The image at `url` (.hdr), or a sky.
export async function loadEnvironment(url) {
    if (!url) {
        return sky(128);
    }
    const { image } = await new HDRLoader().setDataType(THREE.FloatType).loadAsync(url);
    return image;
}

/// A sphere around everything that shows the image, turned about +Y by the uniform `rotation` (rad).
export function background({ width, height, data }) {
    const texture = new THREE.DataTexture(data, width, height, THREE.RGBAFormat, THREE.FloatType);
    texture.minFilter = texture.magFilter = THREE.LinearFilter;
    texture.wrapS = THREE.RepeatWrapping;
    texture.needsUpdate = true;
    const material = new THREE.ShaderMaterial({
        side: THREE.BackSide,
        depthWrite: false,
        uniforms: { image: { value: texture }, rotation: { value: 0 } },
        vertexShader: /* glsl */ `
            varying vec3 direction;
            void main() {
                direction = position;
                vec4 clip = projectionMatrix * vec4(mat3(viewMatrix) * position, 1.0);
                gl_Position = clip.xyww;
            }`,
        fragmentShader: /* glsl */ `
            uniform sampler2D image;
            uniform float rotation;
            varying vec3 direction;
            // Its own direction in the image: turned back. The centre looks toward -Z, u grows toward +X.
            void main() {
                vec3 d = normalize(direction);
                float phi = atan(d.x, -d.z) + rotation;
                vec2 uv = vec2(phi / ${2 * Math.PI} + 0.5, acos(clamp(d.y, -1.0, 1.0)) / ${Math.PI});
                gl_FragColor = vec4(textureLod(image, uv, 0.0).rgb, 1.0);
                #include <tonemapping_fragment>
                #include <colorspace_fragment>
            }`,
    });
    const sphere = new THREE.Mesh(new THREE.SphereGeometry(1, 64, 32), material);
    sphere.frustumCulled = false;
    sphere.renderOrder = -1;
    return sphere;
}
