//! Light-space perspective warping of a spot light's depth view: it spends texels where the camera looks.
//!
//! Wimmer, Scherzer and Purgathofer, "Light Space Perspective Shadow Maps" (2004), for a light that is itself a
//! perspective projection. In its image plane, the warp is a projective map of (x, y, w) that looks along the camera's
//! direction. Depth stays near / w', which keeps the order of points along every light ray.

use glam::{Mat4, Vec2, Vec3, Vec4, Vec4Swizzles};
use gpugi_scene::Bounds;

use crate::capture::View;
use crate::capture::depth::DepthViewSpec;
use crate::capture::frustum_planes;
use crate::scene::{box_faces, clip};

/// The depth view of a light that shines along `direction`, warped toward what `view` sees of `bounds`; unchanged where
/// warping gains nothing.
pub fn warped(
    spec: DepthViewSpec,
    direction: Vec3,
    bounds: &Bounds,
    view: &View,
    gutter: u32,
) -> DepthViewSpec {
    // The part of the scene that lies both in the camera's frustum and in the light's: all of it lies in front of both.
    let planes = frustum_planes(&view.clip_from_world)
        .into_iter()
        .chain(frustum_planes(&spec.clip_from_world));
    let corners = planes.fold(box_faces(bounds), clip).concat();
    let clip_of = |point: Vec3| spec.clip_from_world * point.extend(1.0);
    let seen: Vec<Vec2> = corners
        .iter()
        .map(|&corner| clip_of(corner))
        .filter(|clip| clip.w > 0.0)
        .map(|clip| clip.xy() / clip.w)
        .collect();
    let eye = clip_of(view.world_from_view.w_axis.truncate());
    if seen.len() < 4 || eye.w <= 0.0 {
        return spec;
    }
    let eye = eye.xy() / eye.w;
    let middle = seen.iter().sum::<Vec2>() / seen.len() as f32;
    // A rotation to axes along the camera's direction in the light's image, and across it.
    let along = (middle - eye).normalize_or(Vec2::Y);
    let across = Vec2::new(along.y, -along.x);
    let (y_low, y_high) = range(seen.iter().map(|point| point.dot(along)));
    // Room for filters around the visible part.
    let margin = (y_high - y_low) * (0.01 + 2.0 * gutter as f32 / spec.size[0] as f32);
    let (y0, y1) = (y_low - margin, y_high + margin);
    if y1 - y0 < 1e-4 {
        return spec;
    }
    // D = (y - y0 + n) / n grows from 1 at y0. The paper's best n = z + sqrt(z f), with z and f the distances of the
    // near and far ends from the eye (equation 7), grows without limit when the camera looks along the light. There,
    // warping gains nothing.
    let nearest = (y0 - eye.dot(along)).max(0.05 * (y1 - y0));
    let sine = view
        .world_from_view
        .z_axis
        .truncate()
        .cross(direction)
        .length();
    let n = (nearest + (nearest * (nearest + y1 - y0)).sqrt()) / sine.max(0.01);
    let divisor = |y: f32| (y - y0 + n) / n;
    let (x_low, x_high) = range(
        seen.iter()
            .map(|point| point.dot(across) / divisor(point.dot(along))),
    );
    let x_margin = (x_high - x_low) * (0.01 + 2.0 * gutter as f32 / spec.size[0] as f32);
    let (x0, x1) = (x_low - x_margin, x_high + x_margin);
    if x1 - x0 < 1e-4 {
        return spec;
    }
    // y' = a + b / D maps y0 to -1 and y1 to 1; x' = (s x + t D) / D maps x0 and x1 likewise.
    let far = divisor(y1);
    let b = -2.0 * far / (far - 1.0);
    let a = -1.0 - b;
    let s = 2.0 / (x1 - x0);
    let t = -(x1 + x0) / (x1 - x0);
    // Rows of the map on clip coordinates (x, y, z, w).
    let w_row = Vec4::new(along.x, along.y, 0.0, n - y0) / n;
    let x_row = Vec4::new(across.x, across.y, 0.0, 0.0) * s + w_row * t;
    let y_row = w_row * a + Vec4::W * b;
    let warp = Mat4::from_cols(x_row, y_row, Vec4::Z, w_row).transpose();
    DepthViewSpec {
        clip_from_world: warp * spec.clip_from_world,
        // The widest texel: where one texel was, x' has s / D texels and y' at least -b / (n D^2); distance contributes
        // one factor D.
        texel: spec.texel * (1.0 / s).max(far * n / -b),
        ..spec
    }
}

fn range(values: impl Iterator<Item = f32>) -> (f32, f32) {
    values.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use gpugi_scene::Camera;

    /// A spot light high above a long floor, and a camera low above the floor that looks along it.
    fn scene() -> (DepthViewSpec, Bounds, View) {
        let bounds = Bounds {
            min: Vec3::new(-20.0, 0.0, -20.0),
            max: Vec3::new(20.0, 2.0, 20.0),
        };
        let eye = Vec3::new(0.0, 30.0, 0.0);
        let spec = DepthViewSpec::perspective(eye, Vec3::NEG_Y, Vec3::X, 1.0, 0.01, 1024, 4);
        let camera = Camera::look_at("", Vec3::new(0.0, 2.0, 18.0), Vec3::new(0.0, 0.5, 0.0), 0.8);
        (
            spec,
            bounds,
            View::new(&camera, [320, 240], Vec2::ZERO, 0, 0, 60.0),
        )
    }

    /// Floor points that light and camera both see.
    fn visible(spec: &DepthViewSpec, view: &View) -> Vec<Vec3> {
        let inside = |matrix: &Mat4, point: Vec3| {
            let clip = *matrix * point.extend(1.0);
            clip.w > 0.0 && clip.x.abs() <= clip.w && clip.y.abs() <= clip.w
        };
        (0..40)
            .flat_map(|z| (0..40).map(move |x| Vec3::new(x as f32 - 19.5, 0.0, z as f32 - 19.5)))
            .filter(|&point| {
                inside(&view.clip_from_world, point) && inside(&spec.clip_from_world, point)
            })
            .collect()
    }

    /// Image area per unit of floor area at a point, in texels or pixels of a 2 x 2 square.
    fn density(matrix: &Mat4, point: Vec3) -> f32 {
        let at = |point: Vec3| {
            let clip = *matrix * point.extend(1.0);
            clip.xy() / clip.w
        };
        let step = 1e-2;
        ((at(point + Vec3::X * step) - at(point)).perp_dot(at(point + Vec3::Z * step) - at(point))
            / (step * step))
            .abs()
    }

    #[test]
    fn everything_seen_stays_in_the_tile_and_in_order() {
        let (spec, bounds, view) = scene();
        let warped = warped(spec, Vec3::NEG_Y, &bounds, &view, 4);
        let points = visible(&spec, &view);
        assert!(points.len() > 100);
        for point in points {
            let depth = |height: f32| {
                // A point on the light's ray through the floor point.
                let on_ray = point.lerp(Vec3::new(0.0, 30.0, 0.0), height);
                let clip = warped.clip_from_world * on_ray.extend(1.0);
                assert!(
                    clip.w > 0.0 && clip.x.abs() <= clip.w && clip.y.abs() <= clip.w,
                    "{point} is outside"
                );
                (clip.xyz() / clip.w).z
            };
            assert!(depth(0.1) > depth(0.0), "nearer is greater");
        }
    }

    #[test]
    fn a_camera_along_the_floor_gains_texels_a_pixel() {
        let (spec, bounds, view) = scene();
        let warped = warped(spec, Vec3::NEG_Y, &bounds, &view, 4);
        let points = visible(&spec, &view);
        // Texels per pixel: the mean over pixels of the logarithm, and the worst pixel.
        let rate = |spec: &DepthViewSpec, point: Vec3| {
            density(&spec.clip_from_world, point) / density(&view.clip_from_world, point)
        };
        let mut total = 0.0;
        let mut weights = 0.0;
        let mut worst = [f32::INFINITY; 2];
        for &point in &points {
            let pixels = density(&view.clip_from_world, point);
            total += pixels * (rate(&warped, point) / rate(&spec, point)).ln();
            weights += pixels;
            worst = [
                worst[0].min(rate(&spec, point)),
                worst[1].min(rate(&warped, point)),
            ];
        }
        let mean = (total / weights).exp();
        let worst = worst[1] / worst[0];
        println!("gain: mean {mean:.2}, worst pixel {worst:.2}");
        assert!(mean > 1.5, "{mean}");
        assert!(worst > 1.5, "{worst}");
    }
}
