// Real, orthonormal spherical harmonics with the polar axis +Y, in the order l (l + 1) + m: those of the direction
// (x, y, z) are the usual ones of (z, x, y).

/// All functions below `order` in the unit direction (x, y, z). With Q_lm the normalized associated Legendre functions
/// over sin^m theta, c = (z + ix)^m and the polar coordinate y:
///     Y_lm = sqrt(2) Q_lm Re c,    Y_l-m = sqrt(2) Q_lm Im c,    Y_l0 = Q_l0
///     Q_(l+1)m = a_l+1 (y Q_lm - Q_(l-1)m / a_l),    a_l = sqrt((4 l^2 - 1) / (l^2 - m^2))
///     Q_(m+1)(m+1) = Q_mm sqrt((2 m + 3) / (2 m + 2)),    Q_00 = 1 / sqrt(4 pi)
export function functions(order, [x, y, z]) {
    const values = new Float64Array(order * order);
    let [real, imaginary] = [1, 0];
    let diagonal = Math.sqrt(1 / (4 * Math.PI));
    for (let m = 0; m < order; m++) {
        let [before, legendre, inverse] = [0, diagonal, 0];
        for (let l = m; l < order; l++) {
            const middle = l * (l + 1);
            if (m === 0) {
                values[middle] = legendre;
            } else {
                values[middle + m] = Math.SQRT2 * legendre * real;
                values[middle - m] = Math.SQRT2 * legendre * imaginary;
            }
            const next = l + 1;
            const a = Math.sqrt((4 * next * next - 1) / (next * next - m * m));
            [before, legendre] = [legendre, a * (y * legendre - inverse * before)];
            inverse = 1 / a;
        }
        [real, imaginary] = [real * z - imaginary * x, real * x + imaginary * z];
        diagonal *= Math.sqrt((2 * m + 3) / (2 * m + 2));
    }
    return values;
}

/// L_m = integral of L y_m over the sphere, as [r, g, b] per function. `environment`: an equirectangular image of
/// `width` x `height` texels, four floats each, row by row from the top. +Y is up, the centre looks toward -Z, and u
/// grows toward +X.
export function project(order, { width, height, data }) {
    const light = Array.from({ length: order * order }, () => [0, 0, 0]);
    for (let row = 0; row < height; row++) {
        const edge = (at) => Math.cos((Math.PI * at) / height);
        const solidAngle = ((2 * Math.PI) / width) * (edge(row) - edge(row + 1));
        const theta = (Math.PI * (row + 0.5)) / height;
        for (let column = 0; column < width; column++) {
            const phi = 2 * Math.PI * ((column + 0.5) / width - 0.5);
            const sine = Math.sin(theta);
            const direction = [Math.sin(phi) * sine, Math.cos(theta), -Math.cos(phi) * sine];
            const texel = 4 * (row * width + column);
            functions(order, direction).forEach((value, m) => {
                for (let channel = 0; channel < 3; channel++) {
                    light[m][channel] += solidAngle * value * data[texel + channel];
                }
            });
        }
    }
    return light;
}

/// The light turned by `angle` (rad) about +Y, which mixes the functions of l, m and l, -m:
///     L'_lm = L_lm cos ma - L_l-m sin ma,    L'_l-m = L_lm sin ma + L_l-m cos ma
export function turned(order, light, angle) {
    const result = light.map((rgb) => [...rgb]);
    for (let l = 1; l < order; l++) {
        const middle = l * (l + 1);
        for (let m = 1; m <= l; m++) {
            const [cosine, sine] = [Math.cos(m * angle), Math.sin(m * angle)];
            for (let channel = 0; channel < 3; channel++) {
                const [even, odd] = [light[middle + m][channel], light[middle - m][channel]];
                result[middle + m][channel] = even * cosine - odd * sine;
                result[middle - m][channel] = even * sine + odd * cosine;
            }
        }
    }
    return result;
}
