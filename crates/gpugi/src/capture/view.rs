//! Views: from where, and through which pixels, captures see surface points.

use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec2, Vec3, Vec4};
use gpugi_scene::{Bounds, Camera, Lens, Projection};

use super::depth::DepthViewSpec;

/// `View` of capture/view.wesl.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct ViewUniform {
    pub origin: [f32; 3],
    pub width: u32,
    pub origin_dx: [f32; 3],
    pub height: u32,
    pub origin_dy: [f32; 3],
    pub sample_index: u32,
    pub direction: [f32; 3],
    pub seed: u32,
    pub direction_dx: [f32; 3],
    pub faces: u32,
    pub direction_dy: [f32; 3],
    pub first_row: u32,
    pub output: u32,
    pub top: u32,
    pub target_first: u32,
    pub target_skip: u32,
    pub asymmetry: f32,
    pub first_texel: u32,
    pub accumulates: u32,
    pub lattice: u32,
}

/// The pixels that a frame lights: one of each square of `interval` x `interval`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lattice {
    /// Distance of such pixels along rows and columns, 1 to 255: at 1, all are lit.
    pub interval: u32,
    /// Column and row of the first, below `interval`.
    pub first: [u32; 2],
}

impl Lattice {
    /// All pixels.
    pub const ALL: Self = Self {
        interval: 1,
        first: [0; 2],
    };

    /// That of frame `frame`, of which so many that follow each other light all pixels, far ones after each other.
    pub fn of_frame(interval: u32, frame: u32) -> Self {
        let turn = frame % (interval * interval);
        let (row, column) = (turn / interval, turn % interval);
        // Of 2 x 2, the diagonal neighbour comes next.
        let first = [(column + row) % interval, column];
        Self { interval, first }
    }

    /// That of the rows from `top` on.
    pub fn below(self, top: u32) -> Self {
        let [column, row] = self.first;
        let above = self.interval - top % self.interval;
        Self {
            first: [column, (row + above) % self.interval],
            ..self
        }
    }

    /// Number of pixels that are lit in an image of `size` pixels.
    pub fn count(self, size: [u32; 2]) -> u32 {
        let along = |axis: usize| {
            (size[axis] + self.interval - 1).saturating_sub(self.first[axis]) / self.interval
        };
        along(0) * along(1)
    }

    /// As shaders read it.
    fn packed(self) -> u32 {
        let [column, row] = self.first;
        match self.interval {
            1 => 0,
            interval => interval | column << 8 | row << 16,
        }
    }
}

/// Distance of a camera's near plane, in diagonals of the scene: as small as clipping allows. Depth is reversed, so its
/// precision does not depend on it, and what is clipped stays small where a landscape or a stray object makes the scene
/// large. A triangle as large as the scene is clipped with an error of about this much.
const NEAR: f32 = 1e-7;

/// A camera for an image of a given size: the rays of its pixels, and the matrix that rasterizes the same view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// What shaders read.
    pub uniform: ViewUniform,
    /// Clip space (reverse depth) from world space.
    pub clip_from_world: Mat4,
    /// Camera position and axes.
    pub world_from_view: Mat4,
    /// Tangents of half the field of view; half extents (m) where orthographic.
    pub half_extent: Vec2,
    /// Whether all rays start at one point.
    pub is_perspective: bool,
}

impl View {
    /// Sample index of a view that belongs to no sample of a picture: maps are generated for all samples alike.
    pub const NO_SAMPLE: u32 = u32::MAX;

    /// The view of `camera` for an image of `size` pixels. `jitter` moves the sample within the pixel, each component
    /// in [-1/2, 1/2]; `diagonal` is the scene's (m).
    pub fn new(
        camera: &Camera,
        size: [u32; 2],
        jitter: Vec2,
        sample_index: u32,
        seed: u32,
        diagonal: f32,
    ) -> Self {
        let [width, height] = size.map(|side| side as f32);
        let aspect = width / height;
        let axes = [0, 1, 2].map(|axis| camera.world_from_view.col(axis).truncate());
        let (right, up, forward) = (axes[0], axes[1], -axes[2]);
        let eye = camera.world_from_view.w_axis.truncate();
        let (half_extent, is_perspective) = match camera.projection {
            Projection::Perspective { vertical_fov } => {
                let tangent = (vertical_fov / 2.0).tan();
                (Vec2::new(tangent * aspect, tangent), true)
            }
            Projection::Orthographic { height } => {
                (Vec2::new(height * aspect, height) / 2.0, false)
            }
        };
        // World-space offsets from the image centre to the sample of pixel (0, 0), and from pixel to pixel.
        let across = right * (2.0 * half_extent.x / width);
        let down = up * (-2.0 * half_extent.y / height);
        let first = right * (half_extent.x * ((1.0 + 2.0 * jitter.x) / width - 1.0))
            + up * (half_extent.y * (1.0 - (1.0 + 2.0 * jitter.y) / height));
        let zero = Vec3::ZERO;
        let (origin, origin_dx, origin_dy, direction, direction_dx, direction_dy) =
            if is_perspective {
                (eye, zero, zero, forward + first, across, down)
            } else {
                (eye + first, across, down, forward, zero, zero)
            };
        let view_from_world = camera.world_from_view.inverse();
        let clip_from_view = if is_perspective {
            perspective_reverse_infinite(half_extent, diagonal * NEAR)
        } else {
            orthographic_reverse(half_extent, 0.0, (eye.length() + diagonal) * 4.0)
        };
        // The rasterizer samples pixel centres, so shift the image in the opposite direction.
        let shift = Mat4::from_translation(Vec3::new(
            -2.0 * jitter.x / width,
            2.0 * jitter.y / height,
            0.0,
        ));
        Self {
            uniform: ViewUniform {
                origin: origin.to_array(),
                width: size[0],
                origin_dx: origin_dx.to_array(),
                height: size[1],
                origin_dy: origin_dy.to_array(),
                sample_index,
                accumulates: u32::from(sample_index > 0),
                direction: direction.to_array(),
                seed,
                direction_dx: direction_dx.to_array(),
                faces: 1,
                direction_dy: direction_dy.to_array(),
                ..Zeroable::zeroed()
            },
            clip_from_world: shift * clip_from_view * view_from_world,
            world_from_view: camera.world_from_view,
            half_extent,
            is_perspective,
        }
    }
}

impl View {
    /// The same sample as the first of its picture, or as one that is added to those before it.
    pub fn accumulating(mut self, accumulates: bool) -> Self {
        self.uniform.accumulates = accumulates.into();
        self
    }

    /// What the camera sees through a point of its lens, which lies `beside` the lens's centre (m, to the right and up):
    /// what lies at the distance `focus` along the axis stays where it is in the picture, and the rest moves. With l the
    /// point, rays start at o + l and point to d - l / f.
    pub fn through(mut self, beside: Vec2, focus: f32) -> Self {
        let axes = [0, 1].map(|axis| self.world_from_view.col(axis).truncate());
        let beside_in_world = axes[0] * beside.x + axes[1] * beside.y;
        let moved = |from: [f32; 3], by: Vec3| (Vec3::from(from) + by).to_array();
        self.uniform.origin = moved(self.uniform.origin, beside_in_world);
        self.uniform.direction = moved(self.uniform.direction, -beside_in_world / focus);
        // In view space, whose points in focus have z = -f: x' = x - l - l z / f.
        let mut shear = Mat4::from_translation(-beside.extend(0.0));
        shear.z_axis = (-beside / focus).extend(1.0).extend(0.0);
        let view_from_world = self.world_from_view.inverse();
        let sheared_from_world = self.world_from_view * shear * view_from_world;
        self.clip_from_world *= sheared_from_world;
        self
    }

    /// The same with light at the points of a lattice alone.
    pub(crate) fn lit_on(mut self, lattice: Lattice) -> Self {
        self.uniform.lattice = lattice.packed();
        self
    }

    /// A pinhole camera that sees all that `camera` sees through any point of its lens, in pictures of `size` pixels: it
    /// stands so far behind the lens, and its field of view is so much wider. For maps that follow the camera.
    pub fn behind_lens(camera: &Camera, size: [u32; 2], diagonal: f32) -> Camera {
        let mut camera = camera.clone();
        let Lens {
            aperture, focus, ..
        } = std::mem::take(&mut camera.lens);
        if aperture == 0.0 {
            return camera;
        }
        let narrower = (size[0] as f32 / size[1] as f32).min(1.0);
        let eye = camera.world_from_view.w_axis;
        match &mut camera.projection {
            // At the distance z, points of the lens see a |z / f - 1| farther to each side than its middle: less than
            // a + z a / f.
            Projection::Perspective { vertical_fov } => {
                let tangent = (*vertical_fov / 2.0).tan();
                *vertical_fov = 2.0 * (tangent + aperture / focus / narrower).atan();
                let behind = aperture / (tangent * narrower);
                camera.world_from_view.w_axis += camera.world_from_view.z_axis * behind;
            }
            Projection::Orthographic { height } => {
                let farthest = eye.truncate().length() + diagonal;
                *height += 2.0 * aperture * (farthest / focus - 1.0).max(1.0) / narrower;
            }
        }
        camera
    }

    /// What the same camera sees in a picture of another size, in no sample, for a scene of this `diagonal` (m).
    pub fn at_size(&self, size: [u32; 2], diagonal: f32) -> Self {
        let projection = if self.is_perspective {
            Projection::Perspective {
                vertical_fov: 2.0 * self.half_extent.y.atan(),
            }
        } else {
            Projection::Orthographic {
                height: 2.0 * self.half_extent.y,
            }
        };
        let camera = Camera {
            name: Default::default(),
            world_from_view: self.world_from_view,
            projection,
            lens: Lens::PINHOLE,
            shutter: 0.0,
            node: None,
        };
        Self::new(&camera, size, Vec2::ZERO, Self::NO_SAMPLE, 0, diagonal)
    }

    /// The rows `rows` of this view's picture, lit as a picture of their own: the same rays, the same random numbers.
    pub fn of_rows(&self, rows: &std::ops::Range<u32>) -> Self {
        let all = self.uniform.height as f32;
        let (top, bottom) = (rows.start as f32, rows.end as f32);
        // In normalized device coordinates the rows' centre lies at `middle`, and they reach `half` to either side.
        let middle = 1.0 - (top + bottom) / all;
        let half = (bottom - top) / all;
        let mut stretch = Mat4::IDENTITY;
        stretch.y_axis.y = 1.0 / half;
        stretch.w_axis.y = -middle / half;
        Self {
            uniform: ViewUniform {
                height: rows.end - rows.start,
                top: rows.start,
                ..self.uniform
            },
            clip_from_world: stretch * self.clip_from_world,
            ..*self
        }
    }
}

/// The six faces of a cube around a point, stacked vertically in one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CubeView {
    /// What shaders read.
    pub uniform: ViewUniform,
    /// Clip space (reverse depth) of each face from world space.
    pub clip_from_world: [Mat4; 6],
}

impl CubeView {
    /// The cube around `eye` with faces of `side` x `side` texels. Surfaces nearer than `near` (m) are not seen.
    pub fn new(eye: Vec3, side: u32, near: f32, sample_index: u32, seed: u32) -> Self {
        let faces = DepthViewSpec::cube(eye, near, side, 0);
        let zero = [0.0; 3];
        Self {
            uniform: ViewUniform {
                origin: eye.to_array(),
                width: side,
                origin_dx: zero,
                height: 6 * side,
                origin_dy: zero,
                sample_index,
                accumulates: u32::from(sample_index > 0),
                direction: zero,
                seed,
                direction_dx: zero,
                faces: 6,
                direction_dy: zero,
                ..Zeroable::zeroed()
            },
            clip_from_world: faces.map(|face| face.clip_from_world),
        }
    }
}

impl CubeView {
    /// The six faces of a box, seen from outside along their normals: parallel views with `side` x `side` texels each.
    pub fn of_box(bounds: &Bounds, side: u32) -> Self {
        let center = bounds.center();
        // Slightly larger, so that what lies in the box's faces is seen, and no face has zero size.
        let half = (bounds.max - bounds.min) * 0.505 + Vec3::splat(bounds.diagonal() * 1e-3);
        let cube = Self::new(center, side, 0.0, 0, 0);
        Self {
            uniform: ViewUniform {
                origin_dx: half.to_array(),
                faces: 7,
                ..cube.uniform
            },
            clip_from_world: std::array::from_fn(|face| {
                let [u, v, axis] = cube_frame(face);
                // Reverse depth: greater farther out.
                let rows = [-u / half, -v / half, 0.5 * axis / half].map(|row| row.extend(0.0));
                let mut clip_from_world = Mat4::from_cols(rows[0], rows[1], rows[2], Vec4::W);
                clip_from_world = clip_from_world.transpose();
                clip_from_world.w_axis.z = 0.5;
                clip_from_world * Mat4::from_translation(-center)
            }),
        }
    }
}

/// Axes of a cube's face: along its two coordinates, and outward (`frame` of shared/cube.wesl).
fn cube_frame(face: usize) -> [Vec3; 3] {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    match face {
        0 => [-z, -y, x],
        1 => [z, -y, -x],
        2 => [x, z, y],
        3 => [x, -z, -y],
        4 => [x, -y, z],
        _ => [-x, -y, -z],
    }
}

/// Perspective projection with an infinite far plane and reverse depth: depth = near / distance.
pub fn perspective_reverse_infinite(half_tangents: Vec2, near: f32) -> Mat4 {
    Mat4::from_cols(
        Vec4::new(1.0 / half_tangents.x, 0.0, 0.0, 0.0),
        Vec4::new(0.0, 1.0 / half_tangents.y, 0.0, 0.0),
        Vec4::new(0.0, 0.0, 0.0, -1.0),
        Vec4::new(0.0, 0.0, near, 0.0),
    )
}

/// Parallel projection with reverse depth: depth = (far - distance) / (far - near).
pub fn orthographic_reverse(half_extents: Vec2, near: f32, far: f32) -> Mat4 {
    let range = far - near;
    Mat4::from_cols(
        Vec4::new(1.0 / half_extents.x, 0.0, 0.0, 0.0),
        Vec4::new(0.0, 1.0 / half_extents.y, 0.0, 0.0),
        Vec4::new(0.0, 0.0, 1.0 / range, 0.0),
        Vec4::new(0.0, 0.0, far / range, 1.0),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_light_every_pixel_in_turn() {
        let size = [7, 5];
        for interval in 1..=4 {
            let mut lit = [[0; 7]; 5];
            for frame in 0..interval * interval {
                let lattice = Lattice::of_frame(interval, frame);
                // In two strips, as a picture that exceeds a buffer.
                for rows in [0..3_u32, 3..size[1]] {
                    let own = lattice.below(rows.start);
                    let [column, row] = own.first.map(|first| first as usize);
                    let mut count = 0;
                    for y in
                        (rows.start as usize + row..rows.end as usize).step_by(interval as usize)
                    {
                        for x in (column..7).step_by(interval as usize) {
                            lit[y][x] += 1;
                            count += 1;
                        }
                    }
                    assert_eq!(own.count([size[0], rows.end - rows.start]), count);
                }
            }
            assert_eq!(lit, [[1; 7]; 5], "{interval}");
        }
        assert_eq!(Lattice::ALL.packed(), 0);
        assert_eq!(Lattice::of_frame(2, 1).first, [1, 1]);
    }
}
