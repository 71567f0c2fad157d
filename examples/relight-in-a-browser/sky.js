/// A sky with a soft sun and grey ground: an equirectangular image as `project` of harmonics.js takes it.
export function sky(width) {
    const height = width / 2;
    const data = new Float32Array(4 * width * height);
    const sun = [0.6, 0.64, 0.48];
    for (let texel = 0; texel < width * height; texel++) {
        const phi = 2 * Math.PI * (((texel % width) + 0.5) / width - 0.5);
        const theta = (Math.PI * (Math.floor(texel / width) + 0.5)) / height;
        const y = Math.cos(theta);
        const cosine =
            sun[0] * Math.sin(phi) * Math.sin(theta) + sun[1] * y - sun[2] * Math.cos(phi) * Math.sin(theta);
        const glow = 8 * Math.exp(12 * (cosine - 1));
        const color = y > 0 ? [0.3, 0.45, 0.8] : [0.2, 0.2, 0.2];
        data.set([color[0] + glow, color[1] + 0.9 * glow, color[2] + 0.7 * glow, 1], 4 * texel);
    }
    return { width, height, data };
}
