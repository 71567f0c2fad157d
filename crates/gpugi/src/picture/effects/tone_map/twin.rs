//! The display's formulas in double precision, written from their sources independently of the shaders.

use super::ToneMap;

/// sRGB-encoded display value, from 0 to 1, of exposed linear radiance.
pub(in crate::picture) fn encoded(
    operator: ToneMap,
    exposed: [f64; 3],
    white_point: f64,
) -> [f64; 3] {
    let display = match operator {
        ToneMap::None => exposed,
        ToneMap::Reinhard => reinhard(exposed, white_point),
        ToneMap::Aces => aces(exposed),
        ToneMap::AgX => agx(exposed),
        ToneMap::Neutral => neutral(exposed),
    };
    display.map(|value| srgb_from_linear(value.clamp(0.0, 1.0)))
}

pub(in crate::picture) fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

pub(in crate::picture) fn srgb_from_linear(linear: f64) -> f64 {
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}

fn reinhard(exposed: [f64; 3], white_point: f64) -> [f64; 3] {
    let from = luminance(exposed);
    if from == 0.0 {
        return exposed;
    }
    let to = from * (1.0 + from / white_point.powi(2)) / (1.0 + from);
    exposed.map(|channel| channel * to / from)
}

fn aces(exposed: [f64; 3]) -> [f64; 3] {
    let v = transform(
        [
            [0.59719, 0.35458, 0.04823],
            [0.07600, 0.90834, 0.01566],
            [0.02840, 0.13383, 0.83777],
        ],
        exposed,
    );
    let fitted = v
        .map(|v| (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081));
    transform(
        [
            [1.60475, -0.53108, -0.07367],
            [-0.10208, 1.10813, -0.00605],
            [-0.00327, -0.07276, 1.07602],
        ],
        fitted,
    )
}

fn agx(exposed: [f64; 3]) -> [f64; 3] {
    let inset = transform(
        [
            [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
            [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
            [0.0423756549057051, 0.0784336, 0.879142973793104],
        ],
        exposed,
    );
    let (least, most) = (-12.47393, 4.026069);
    let curve = inset.map(|value| {
        let x = (value.log2().clamp(least, most) - least) / (most - least);
        15.5 * x.powi(6) - 40.14 * x.powi(5) + 31.96 * x.powi(4) - 6.868 * x.powi(3)
            + 0.4298 * x.powi(2)
            + 0.1191 * x
            - 0.00232
    });
    transform(
        [
            [1.19687900512017, -0.0980208811401368, -0.0990297440797205],
            [-0.0528968517574562, 1.15190312990417, -0.0989611768448433],
            [-0.0529716355144438, -0.0980434501171241, 1.15107367264116],
        ],
        curve,
    )
    .map(|value| value.max(0.0).powf(2.2))
}

fn neutral([r, g, b]: [f64; 3]) -> [f64; 3] {
    let least = r.min(g).min(b);
    let offset = if least <= 0.08 {
        least - least.powi(2) / (4.0 * 0.04)
    } else {
        0.04
    };
    let base = [r - offset, g - offset, b - offset];
    let peak = base[0].max(base[1]).max(base[2]);
    let start = 0.76;
    if peak <= start {
        return base;
    }
    let compressed = 1.0 - (1.0 - start).powi(2) / (peak + 1.0 - 2.0 * start);
    let hue_share = 1.0 / (0.15 * (peak - compressed) + 1.0);
    base.map(|channel| channel * compressed / peak * hue_share + compressed * (1.0 - hue_share))
}

/// Multiplies a matrix, given by rows, by a column vector.
fn transform(rows: [[f64; 3]; 3], column: [f64; 3]) -> [f64; 3] {
    rows.map(|row| row[0] * column[0] + row[1] * column[1] + row[2] * column[2])
}
