import * as THREE from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { background, loadEnvironment } from './environment.js';
import { project, turned } from './harmonics.js';
import { lightUniform, loadTransfer, relight, setLight } from './transfer.js';

const asked = new URLSearchParams(location.search);

async function load() {
    const [gltf, environment] = await Promise.all([
        new GLTFLoader().loadAsync(asked.get('scene') ?? 'baked.glb'),
        loadEnvironment(asked.get('environment')),
    ]);
    const transfer = await loadTransfer(gltf);
    const projected = project(transfer.order, environment);
    const light = lightUniform(transfer);
    gltf.scene.traverse((object) => object.isMesh && relight(object, transfer, light));
    const behind = background(environment);
    const scene = new THREE.Scene().add(gltf.scene, behind);
    const turn = (angle) => {
        setLight(light, transfer, turned(transfer.order, projected, angle));
        behind.material.uniforms.rotation.value = angle;
    };
    turn(THREE.MathUtils.degToRad(Number(asked.get('rotation') ?? 0)));
    scene.updateMatrixWorld(true);
    const { center } = new THREE.Box3().setFromObject(gltf.scene).getBoundingSphere(new THREE.Sphere());
    return { scene, camera: gltf.cameras[0] ?? framing(gltf.scene), center, turn };
}

/// A camera that sees a whole scene.
function framing(object) {
    const sphere = new THREE.Box3().setFromObject(object).getBoundingSphere(new THREE.Sphere());
    const camera = new THREE.PerspectiveCamera(40, 1, 0.01 * sphere.radius, 10 * sphere.radius);
    camera.position.copy(sphere.center).add(new THREE.Vector3(1, 0.6, 2).setLength(3 * sphere.radius));
    camera.lookAt(sphere.center);
    return camera;
}

function show({ scene, camera, center, turn }) {
    const renderer = new THREE.WebGLRenderer({ antialias: true });
    renderer.toneMapping = THREE.ACESFilmicToneMapping;
    document.body.append(renderer.domElement);
    // The file's camera may hang below another object.
    const view = camera.clone();
    camera.matrixWorld.decompose(view.position, view.quaternion, view.scale);
    const draw = () => renderer.render(scene, view);
    // It turns around the point straight ahead that is as far away as the scene.
    const ahead = view.getWorldDirection(new THREE.Vector3());
    const distance = Math.max(center.clone().sub(view.position).dot(ahead), 0.01);
    const target = view.position.clone().addScaledVector(ahead, distance);
    const controls = new OrbitControls(view, renderer.domElement);
    controls.mouseButtons = { LEFT: null, MIDDLE: THREE.MOUSE.DOLLY, RIGHT: THREE.MOUSE.ROTATE };
    controls.target.copy(target);
    controls.update();
    controls.addEventListener('change', draw);
    let angle = THREE.MathUtils.degToRad(Number(asked.get('rotation') ?? 0));
    addEventListener('pointermove', (event) => {
        if (event.buttons & 1) {
            angle += 0.01 * event.movementX;
            turn(angle);
            draw();
        }
    });
    const resize = () => {
        view.aspect = innerWidth / innerHeight;
        view.updateProjectionMatrix();
        renderer.setSize(innerWidth, innerHeight);
        draw();
    };
    addEventListener('resize', resize);
    resize();
}

/// Posts a picture as RGBA floats, rows from the bottom, to the server: for tests. Pixels are means of 8 x 8.
async function post({ scene, camera }, [width, height]) {
    const times = 8;
    const renderer = new THREE.WebGLRenderer();
    const target = new THREE.WebGLRenderTarget(times * width, times * height, { type: THREE.FloatType });
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    renderer.setRenderTarget(target);
    renderer.render(scene, camera);
    const fine = new Float32Array(4 * target.width * target.height);
    renderer.readRenderTargetPixels(target, 0, 0, target.width, target.height, fine);
    const picture = new Float32Array(4 * width * height);
    for (let at = 0; at < fine.length; at++) {
        const [x, y] = [Math.floor(at / 4) % target.width, Math.floor(at / 4 / target.width)];
        const pixel = Math.floor(y / times) * width + Math.floor(x / times);
        picture[4 * pixel + (at % 4)] += fine[at] / times ** 2;
    }
    await fetch('/picture', { method: 'POST', body: picture });
}

try {
    const loaded = await load();
    const size = asked.get('post');
    await (size ? post(loaded, size.split('x').map(Number)) : show(loaded));
} catch (error) {
    document.body.append(String(error));
    if (asked.has('post')) {
        await fetch('/error', { method: 'POST', body: String(error?.stack ?? error) });
    }
}
