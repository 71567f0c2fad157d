//! Sampling by bundles of parallel lines through the whole scene, whose hits are peeled one after the other.

use std::f32::consts::TAU;

use bytemuck::Zeroable;
use glam::{Mat4, Vec2, Vec3};
use gpugi_scene::Bounds;

use super::Settings;
use super::gpu::{Bundle, PeelView, SettingsUniform};
use crate::capture::atlas::{AtlasCapture, AtlasLookup};
use crate::capture::orthographic_reverse;
use crate::gpu::{
    DepthTest, Frame, Gpu, GpuError, Keeps, Kernel, Named, RasterKernel, RasterState,
};
use crate::scene::{DrawClass, GpuScene};
use crate::sequences::{GOLDEN_RATIO, R2, low_discrepancy};
use crate::shader;

/// Fewest pixels per side of a bundle.
const LEAST_SIDE: u32 = 16;
/// Words per hit.
const HIT_WORDS: u64 = 3;

/// Takes samples by peeling.
#[derive(Debug)]
pub(super) struct Peeling {
    /// For opaque surfaces, and for those with alpha.
    peel: [RasterKernel; 2],
    transfer: Kernel,
    /// Where triangles find their texels.
    atlas: wgpu::Buffer,
    side: u32,
    /// Lines per bundle that meet a texel of mean size facing them.
    lines_of_texel: f32,
    /// Buffer for the lines' hits (hits.wesl), and its capacity in hits.
    hits: Option<(wgpu::Buffer, u32)>,
    /// Attachment that the rasterizer requires; nothing is drawn to it.
    target: wgpu::TextureView,
    most_layers: u32,
    /// Number of bundles; 0 if there are no texels.
    directions: u32,
    seed: u32,
}

impl Peeling {
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        capture: &AtlasCapture,
        settings: &Settings,
        lookup: &AtlasLookup,
    ) -> Result<Self, GpuError> {
        let raster = |shader| {
            let state = RasterState {
                colors: &[],
                blend: None,
                constants: &[],
                cull: None,
                slope_bias: 0.0,
                has_fragment: true,
                has_vertices: true,
                depth: DepthTest::Off,
            };
            RasterKernel::new(gpu, &shader, Some(&scene.layout), &state)
        };
        let texels = scene.bounds.diagonal() / capture.texel_side.max(f32::MIN_POSITIVE);
        let most = settings
            .most_lines
            .min(gpu.limits().max_texture_dimension_2d);
        let side = ((texels * settings.lines).ceil().min(65_536.0) as u32).clamp(LEAST_SIDE, most);
        let target = gpu.texture_2d(
            "bundle of lines",
            [side, side, 1],
            wgpu::TextureFormat::Depth32Float,
            wgpu::TextureUsages::RENDER_ATTACHMENT,
        )?;
        let transfer = shader!("techniques.obscurances.transfer");
        let (layout, colored) = (Some(&scene.layout), [super::solution::colored(settings)]);
        Ok(Self {
            peel: [
                raster(shader!("techniques.obscurances.peel"))?,
                raster(shader!("techniques.obscurances.peel_alpha"))?,
            ],
            transfer: Kernel::with_constants(gpu, &transfer, "main", layout, &colored)?,
            atlas: lookup.words.clone(),
            side,
            lines_of_texel: (side as f32 / texels.max(1.0)).powi(2),
            hits: None,
            target: target.create_view(&Default::default()),
            most_layers: settings.layers,
            directions: match capture.pieces() {
                [] => 0,
                _ => settings.directions,
            },
            seed: settings.seed,
        })
    }

    /// Whether there are texels to sample.
    pub fn has_texels(&self) -> bool {
        self.directions > 0
    }

    /// Samples that a texel needs to do without its neighbours' samples: a quarter of those of a texel of mean size,
    /// which lines meet at a mean cosine of 1/2.
    pub fn least_samples(&self) -> u32 {
        (self.directions as f32 * self.lines_of_texel / 2.0 / 4.0).min(65_536.0) as u32
    }

    /// Bytes of the hits, and of the attachment that nothing is drawn to.
    pub fn bytes(&self) -> u64 {
        let hits = self.hits.as_ref().map_or(0, |(buffer, _)| buffer.size());
        hits + u64::from(self.side).pow(2) * 4
    }

    /// Makes room for the hits on surfaces with a total area of `area` [m^2], for the present state of `scene`.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
    pub fn make_room(&mut self, gpu: &Gpu, scene: &GpuScene, area: f64) -> Result<(), GpuError> {
        let lines = Lines::new(0, self.seed, &scene.bounds, self.side);
        // However surfaces are oriented, lines hit them at most as often as pixels fit on their area, except for chance
        // at edges.
        let most = area / f64::from(lines.pixel()).powi(2) * 1.05 + 65_536.0;
        let most = most.min(f64::from(u32::MAX)) as u32;
        if self.hits.as_ref().is_some_and(|(_, room)| *room >= most) {
            return Ok(());
        }
        let words = 1 + u64::from(self.side).pow(2) + u64::from(most) * HIT_WORDS;
        let label = "what lines meet, fewer with a lower obscurances.most-lines [bytes]";
        let buffer = gpu.room(label, words * 4)?;
        self.hits = Some((buffer, most));
        Ok(())
    }

    /// Lines of a bundle.
    pub fn lines(&self) -> u64 {
        u64::from(self.side).pow(2)
    }

    /// Samples by bundle `number`. `region`: box around all texels that are computed; `None` if all texels are.
    pub fn take(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        texels: &wgpu::Buffer,
        number: u32,
        region: Option<Bounds>,
        settings: SettingsUniform,
    ) -> Result<(), GpuError> {
        let Some((hits, room)) = &self.hits else {
            return Ok(());
        };
        let gpu = frame.gpu;
        let lines = Lines::new(number, self.seed, &scene.bounds, self.side);
        let [x, y, width, height] = match region {
            Some(region) => lines.pixels_of(&region),
            None => [0, 0, self.side, self.side],
        };
        if width == 0 || height == 0 {
            return Ok(());
        }
        let settings = gpu.constant("obscurances", &settings)?;
        let alpha = |class: DrawClass| class >= DrawClass::Alpha;
        let of_kind = |is_alpha: bool| {
            let draws = scene
                .draws
                .iter()
                .filter(move |draw| alpha(draw.class) == is_alpha);
            let start = draws
                .clone()
                .map(|draw| draw.indices.start)
                .min()
                .unwrap_or(0);
            let end = draws.map(|draw| draw.indices.end).max().unwrap_or(start);
            start..end
        };
        let ranges = [false, true].map(of_kind);
        let mut first_triangles = vec![0; scene.objects.len()];
        for draw in &scene.draws {
            first_triangles[draw.instance as usize] = draw.indices.start / 3;
        }
        let first_triangles =
            gpu.storage("first triangles of instances [bytes]", &first_triangles)?;

        let view = gpu.uniform(
            "bundle of lines",
            &PeelView {
                clip_from_world: lines.clip_from_world.to_cols_array_2d(),
                seed: [self.seed.wrapping_add(number), self.side, *room, 0],
            },
        )?;
        let bundle = gpu.uniform(
            "bundle of lines",
            &Bundle {
                first_column: x,
                first_row: y,
                end_column: x + width,
                end_row: y + height,
                side: self.side,
                layers: self.most_layers,
                ..lines.bundle
            },
        )?;
        let peel = [
            ("view", view.as_entire_binding()),
            ("first_triangles", first_triangles.as_entire_binding()),
            ("hits", hits.as_entire_binding()),
        ];
        let peel = [
            self.peel[0].bind(gpu, 1, &peel)?,
            self.peel[1].bind(gpu, 1, &peel)?,
        ];
        frame.clear_range(hits, 0..(1 + u64::from(self.side).pow(2)) * 4);
        let (name, keeps) = ("obscurances.peel", Keeps::Everything);
        frame.render_onto(name, keeps, &[], &self.target, |pass| {
            pass.set_bind_group(0, &scene.bind_group, &[]);
            pass.set_vertex_buffer(0, scene.vertices.slice(..));
            pass.set_index_buffer(scene.indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.set_scissor_rect(x, y, width, height);
            for (kind, range) in ranges.iter().enumerate() {
                if !range.is_empty() {
                    self.peel[kind].set(pass);
                    pass.set_bind_group(1, &peel[kind], &[]);
                    pass.draw_indexed(range.clone(), 0, 0..1);
                }
            }
        });
        let transfer: [Named<'_>; 7] = [
            ("settings", &settings),
            ("lines", &bundle),
            ("hits", hits),
            ("indices", &scene.indices),
            ("merged", &scene.vertices),
            ("texels", texels),
            ("atlas", &self.atlas),
        ];
        let (name, own) = ("obscurances.transfer", Some(&scene.bind_group));
        frame.run(name, &self.transfer, own, &transfer, [width, height, 1])
    }
}

/// Parallel lines, one through each pixel of a square around the scene.
struct Lines {
    clip_from_world: Mat4,
    bundle: Bundle,
    view_from_world: Mat4,
    half: f32,
    side: u32,
}

impl Lines {
    /// Element `number` of a sequence that spreads directions evenly over the sphere, and the lines' offsets evenly
    /// over their pixels.
    fn new(number: u32, seed: u32, bounds: &Bounds, side: u32) -> Self {
        // Each line serves both of its directions: a hemisphere covers the whole sphere.
        let [along, around, roll] = offsets(seed);
        let fraction = |value: f64| value.fract() as f32;
        let z = fraction(f64::from(number.reverse_bits()) / f64::from(u32::MAX) + along);
        let phi = TAU * fraction(f64::from(number) * GOLDEN_RATIO + around);
        let radius = (1.0 - z * z).max(0.0).sqrt();
        let direction = Vec3::new(radius * phi.cos(), radius * phi.sin(), z).normalize();
        let (right, up) = direction.any_orthonormal_pair();
        let (sin, cos) = (TAU * fraction(f64::from(number) * R2[0] + roll)).sin_cos();
        let (right, up) = (right * cos + up * sin, up * cos - right * sin);

        // The scene's bounding sphere, and a margin of one pixel for the lines' offsets in their pixels.
        let radius = (bounds.diagonal() / 2.0).max(1e-6) * 1.001;
        let half = radius * (1.0 + 2.0 / side as f32);
        let pixel = 2.0 * half / side as f32;
        let place: Vec2 = (low_discrepancy(number) - 0.5) * pixel;
        let eye = bounds.center() + right * place.x + up * place.y - direction * radius;
        let range = 2.0 * radius;
        let world_from_view = Mat4::from_cols(
            right.extend(0.0),
            up.extend(0.0),
            // Views look along -z, with x to the right and y up.
            (-direction).extend(0.0),
            eye.extend(1.0),
        );
        let view_from_world = world_from_view.inverse();
        let projection = orthographic_reverse(Vec2::splat(half), 0.0, range);
        Self {
            clip_from_world: projection * view_from_world,
            bundle: Bundle {
                origin: (eye + (right - up) * (pixel / 2.0) - (right - up) * half).to_array(),
                range,
                origin_dx: (right * pixel).to_array(),
                origin_dy: (up * -pixel).to_array(),
                direction: direction.to_array(),
                ..Zeroable::zeroed()
            },
            view_from_world,
            half,
            side,
        }
    }

    /// Side of a pixel (m).
    fn pixel(&self) -> f32 {
        2.0 * self.half / self.side as f32
    }

    /// First column and row, width and height of the pixels whose lines may hit a box.
    fn pixels_of(&self, region: &Bounds) -> [u32; 4] {
        let seen = region.transformed(&self.view_from_world);
        let pixels = self.side as f32 / (2.0 * self.half);
        let index = |at: f32| (at * pixels).clamp(0.0, self.side as f32);
        let x = index(seen.min.x + self.half).floor() as u32;
        let y = index(self.half - seen.max.y).floor() as u32;
        let end_x = index(seen.max.x + self.half).ceil() as u32;
        let end_y = index(self.half - seen.min.y).ceil() as u32;
        [x, y, end_x.saturating_sub(x), end_y.saturating_sub(y)]
    }
}

/// Offsets at which the sequences of a seed start, each in [0, 1): SplitMix64.
fn offsets(seed: u32) -> [f64; 3] {
    let mut state = u64::from(seed);
    [(); 3].map(|()| {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    })
}
