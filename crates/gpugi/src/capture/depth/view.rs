//! What the tiles of a depth atlas see: perspective views, cubes and hemicubes of them, and parallel views.

use glam::{Mat4, Vec2, Vec3, Vec4};
use gpugi_scene::Bounds;

use crate::capture::{orthographic_reverse, perspective_reverse_infinite};
use crate::scene::GpuScene;

/// What one tile of a depth atlas sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthViewSpec {
    /// Clip space (reverse depth) from world space.
    pub clip_from_world: Mat4,
    /// Tile size (texels).
    pub size: [u32; 2],
    /// World-space width of a texel along its wider axis (m): perspective, at distance 1; orthographic, everywhere.
    pub texel: f32,
    /// Perspective: near plane (m); orthographic: 0.
    pub near: f32,
    /// Orthographic: depth range (m).
    pub range: f32,
    /// Whether closed meshes may be drawn by their back faces. Not where texels are coarse: a filter that reaches under
    /// a mesh standing on a floor would see the floor there as lit.
    pub second_depth: bool,
}

/// A rigid camera frame looking along `forward`; `forward` and `up` are perpendicular unit vectors.
fn view_from_world(eye: Vec3, forward: Vec3, up: Vec3) -> Mat4 {
    let right = forward.cross(up);
    Mat4::from_cols(
        right.extend(0.0),
        up.extend(0.0),
        (-forward).extend(0.0),
        eye.extend(1.0),
    )
    .inverse()
}

impl DepthViewSpec {
    /// A square perspective view of `side` texels. Its outermost `gutter` texels lie outside the field of view, whose
    /// half-angle has the tangent `half_tangent`, so that filters may reach over the border.
    pub fn perspective(
        eye: Vec3,
        forward: Vec3,
        up: Vec3,
        half_tangent: f32,
        near: f32,
        side: u32,
        gutter: u32,
    ) -> Self {
        let inner = (side - 2 * gutter) as f32;
        let widened = half_tangent * side as f32 / inner;
        Self {
            clip_from_world: perspective_reverse_infinite(Vec2::splat(widened), near)
                * view_from_world(eye, forward, up),
            size: [side, side],
            texel: 2.0 * half_tangent / inner,
            near,
            range: 0.0,
            second_depth: false,
        }
    }

    /// The upper half of a 90 degree view: a side of a hemicube, whose axis is `up`. `gutter` as in
    /// [`Self::perspective`]; there are also `gutter` rows below the horizon.
    pub fn hemicube_side(
        eye: Vec3,
        forward: Vec3,
        up: Vec3,
        near: f32,
        side: u32,
        gutter: u32,
    ) -> Self {
        let full = Self::perspective(eye, forward, up, 1.0, near, side, gutter);
        let height = side / 2 + gutter;
        // Keep the upper rows: y' in [-1, 1] for y in [1 - 2 height / side, 1].
        let kept = height as f32 / side as f32;
        let lift = Mat4::from_cols(
            Vec4::X,
            Vec4::new(0.0, 1.0 / kept, 0.0, 0.0),
            Vec4::Z,
            Vec4::new(0.0, 1.0 - 1.0 / kept, 0.0, 1.0),
        );
        Self {
            clip_from_world: lift * full.clip_from_world,
            size: [side, height],
            ..full
        }
    }

    /// A square parallel view of `side` texels: `half_extent` (m) around `center`, depth from `near` to `far` (m) along
    /// `forward` relative to `center`.
    pub fn orthographic(
        center: Vec3,
        forward: Vec3,
        up: Vec3,
        half_extent: f32,
        near: f32,
        far: f32,
        side: u32,
    ) -> Self {
        Self {
            clip_from_world: orthographic_reverse(Vec2::splat(half_extent), 0.0, far - near)
                * view_from_world(center + forward * near, forward, up),
            size: [side, side],
            texel: 2.0 * half_extent / side as f32,
            near: 0.0,
            range: far - near,
            second_depth: false,
        }
    }

    /// The tightest parallel view of `side` x `side` texels along `forward` that contains a box, with `gutter` texels
    /// to spare at each border. Its texels need not be square.
    pub fn fitted(forward: Vec3, bounds: &Bounds, side: u32, gutter: u32) -> Self {
        let rectangle = Rectangle::around(forward, bounds);
        let depths = span(&corners(bounds), forward);
        Self::parallel(&rectangle, depths, side, gutter)
    }

    /// Like [`Self::fitted`], around the core of a scene and with the depths of everything that lies in front of the core
    /// or behind it.
    pub fn around_core(forward: Vec3, scene: &GpuScene, side: u32, gutter: u32) -> Self {
        if scene.core == scene.bounds {
            return Self::fitted(forward, &scene.bounds, side, gutter);
        }
        let rectangle = Rectangle::around(forward, &scene.core);
        let outer = rectangle.widened(side, gutter);
        let depths = scene.depths_within(&outer.sides(), forward, scene.core.diagonal());
        let depths = depths.unwrap_or_else(|| span(&corners(&scene.core), forward));
        Self::parallel(&rectangle, depths, side, gutter)
    }

    fn parallel(inner: &Rectangle, [low, high]: [f32; 2], side: u32, gutter: u32) -> Self {
        let Rectangle {
            right,
            up,
            center,
            half,
        } = inner.widened(side, gutter);
        let forward = up.cross(right);
        // Give what is flat some thickness, and a margin, so that rounding cuts nothing off at the ends.
        let half_z = ((high - low) / 2.0).max(half.max_element() * 1e-3) * 1.01;
        let near = (low + high) / 2.0 - half_z;
        Self {
            clip_from_world: orthographic_reverse(half, 0.0, 2.0 * half_z)
                * view_from_world(
                    right * center.x + up * center.y + forward * near,
                    forward,
                    up,
                ),
            size: [side, side],
            texel: 2.0 * half.max_element() / side as f32,
            near: 0.0,
            range: 2.0 * half_z,
            second_depth: false,
        }
    }

    /// The six faces of a cube around `eye`: +X, -X, +Y, -Y, +Z, -Z. Their rows are as in shared/cube.wesl; they are
    /// mirrored left to right.
    pub fn cube(eye: Vec3, near: f32, side: u32, gutter: u32) -> [Self; 6] {
        [
            (Vec3::X, Vec3::Y),
            (Vec3::NEG_X, Vec3::Y),
            (Vec3::Y, Vec3::NEG_Z),
            (Vec3::NEG_Y, Vec3::Z),
            (Vec3::Z, Vec3::Y),
            (Vec3::NEG_Z, Vec3::Y),
        ]
        .map(|(forward, up)| Self::perspective(eye, forward, up, 1.0, near, side, gutter))
    }

    /// The five faces of a hemicube above a plane: its top, then the sides toward +tangent, -tangent, +bitangent,
    /// -bitangent with bitangent = normal x tangent.
    pub fn hemicube(
        eye: Vec3,
        normal: Vec3,
        tangent: Vec3,
        near: f32,
        side: u32,
        gutter: u32,
    ) -> [Self; 5] {
        let bitangent = normal.cross(tangent);
        let wall = |forward| Self::hemicube_side(eye, forward, normal, near, side, gutter);
        [
            Self::perspective(eye, normal, tangent, 1.0, near, side, gutter),
            wall(tangent),
            wall(-tangent),
            wall(bitangent),
            wall(-bitangent),
        ]
    }

    /// The hemicubes of a light that shines to both sides: above, then below, with the sides in the same order.
    pub fn hemicubes(
        eye: Vec3,
        normal: Vec3,
        tangent: Vec3,
        near: f32,
        side: u32,
        gutter: u32,
    ) -> [Self; 10] {
        let above = Self::hemicube(eye, normal, tangent, near, side, gutter);
        // Below, the bitangent -normal x tangent points the other way; the face indices of the shader expect the one
        // above.
        let mut below = Self::hemicube(eye, -normal, tangent, near, side, gutter);
        below.swap(3, 4);
        std::array::from_fn(|face| {
            if face < 5 {
                above[face]
            } else {
                below[face - 5]
            }
        })
    }
}

/// A rectangle across parallel rays.
struct Rectangle {
    right: Vec3,
    up: Vec3,
    /// Along `right` and `up` (m).
    center: Vec2,
    half: Vec2,
}

impl Rectangle {
    /// The smallest rectangle across `forward` that a box fits in.
    fn around(forward: Vec3, bounds: &Bounds) -> Self {
        let corners = corners(bounds);
        // Give a flat box some thickness.
        let least = bounds.diagonal().max(1e-6) * 1e-3;
        // The smallest rectangle around a convex polygon has a side along one of the polygon's: here, along an edge of
        // the box.
        let rectangles = [Vec3::X, Vec3::Y, Vec3::Z].into_iter().filter_map(|edge| {
            let up = edge.reject_from_normalized(forward).try_normalize()?;
            let right = forward.cross(up);
            let [x, y] = [right, up].map(|axis| Vec2::from(span(&corners, axis)));
            Some(Self {
                right,
                up,
                center: Vec2::new(x.element_sum(), y.element_sum()) / 2.0,
                half: (Vec2::new(x.y - x.x, y.y - y.x) / 2.0).max(Vec2::splat(least)),
            })
        });
        let area = |rectangle: &Self| rectangle.half.element_product();
        let smallest = rectangles.min_by(|a, b| area(a).total_cmp(&area(b)));
        smallest.unwrap_or(Self {
            right: Vec3::X,
            up: Vec3::Y,
            center: Vec2::ZERO,
            half: Vec2::splat(least),
        })
    }

    /// With a border of `gutter` of `side` texels.
    fn widened(&self, side: u32, gutter: u32) -> Self {
        Self {
            half: self.half * (side as f32 / (side - 2 * gutter) as f32),
            ..*self
        }
    }

    /// Planes of its sides, which have it on their positive sides.
    fn sides(&self) -> [Vec4; 4] {
        [
            (self.right, self.center.x, self.half.x),
            (self.up, self.center.y, self.half.y),
        ]
        .map(|(axis, center, half)| [axis.extend(half - center), (-axis).extend(half + center)])
        .as_flattened()
        .try_into()
        .expect("two sides for each of two axes")
    }
}

/// Corners of a box; of an empty one, the origin.
fn corners(bounds: &Bounds) -> [Vec3; 8] {
    if bounds.is_empty() {
        return [Vec3::ZERO; 8];
    }
    bounds.corners()
}

/// Where points begin and end along an axis.
fn span(points: &[Vec3], axis: Vec3) -> [f32; 2] {
    let along = points.iter().map(|point| point.dot(axis));
    along.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], at| {
        [low.min(at), high.max(at)]
    })
}
