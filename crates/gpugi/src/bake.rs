//! Light in texture space: what techniques add at the texels of an atlas, for files that other software shows (tutorial section 6, 7.3).

use glam::{Vec2, Vec3};
use gpugi_scene::atlas::Seams;
use gpugi_scene::{Atlas, Camera, Projection, Scene};

use crate::capture::atlas::{AtlasCapture, AtlasCaptureOptions, Dilation, LeakReport, LeakTest};
use crate::capture::{Target, View};
use crate::gpu::{Frame, Gpu, read_buffer};
use crate::renderer::{RenderError, Renderer};
use crate::scene::GpuScene;
use crate::techniques::obscurances::{self, ObscurancePage};

pub use crate::capture::atlas::TexelLobes as Quantity;

/// Lights the texels of an atlas, sample by sample.
#[derive(Debug)]
pub struct Bake {
    gpu: Gpu,
    renderer: Renderer,
    capture: AtlasCapture,
    /// The scene, in which rays find the texels that lie inside other things.
    rays: GpuScene,
    leaks: LeakTest,
    targets: Vec<Target>,
    dilations: Vec<Dilation>,
    seams: Seams,
    view: View,
}

impl Bake {
    /// A bake of `scene` into `atlas` by the named techniques. What it holds is said by `quantity`: radiance, or the irradiance over pi.
    ///
    /// # Errors
    /// [`RenderError`].
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        atlas: &Atlas,
        names: &[String],
        quantity: Quantity,
    ) -> Result<Self, RenderError> {
        let renderer = Renderer::new(gpu, scene, [1, 1], names)?;
        let options = AtlasCaptureOptions {
            lobes: quantity,
            ..AtlasCaptureOptions::default()
        };
        let capture = AtlasCapture::new(gpu, scene, renderer.scene(), atlas, &options)?;
        let rays = GpuScene::with_rays(gpu, scene)?;
        let leaks = LeakTest::new(gpu, &rays, &capture)?;
        let (mut targets, mut dilations) = (Vec::new(), Vec::new());
        for piece in capture.pieces() {
            targets.push(Target::new(gpu, piece.points.count)?);
            let rows = piece.rows.end - piece.rows.start;
            dilations.push(Dilation::new(gpu, [capture.size, rows])?);
        }
        // Maps that follow a camera follow one that sees all there is.
        let bounds = scene.bounds();
        let diagonal = renderer.scene().diagonal();
        let center = bounds.center();
        let all = Camera {
            projection: Projection::Orthographic { height: diagonal },
            ..Camera::look_at("all", center + Vec3::Y * diagonal, center, 1.0)
        };
        Ok(Self {
            view: View::new(&all, [1, 1], Vec2::ZERO, 0, 0, diagonal),
            gpu: gpu.clone(),
            seams: Seams::new(scene, atlas),
            renderer,
            capture,
            rays,
            leaks,
            targets,
            dilations,
        })
    }

    /// The renderer whose techniques light the texels: for their settings, and to say what is left out.
    pub fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// Brings maps that become finer from frame to frame one frame further; returns how far they are. At 1 samples may begin.
    ///
    /// # Errors
    /// [`RenderError::Gpu`].
    pub fn refine(&mut self) -> Result<f32, RenderError> {
        Ok(self.renderer.refine(&self.view)?)
    }

    /// Adds a sample of the light of those techniques whose names `adds` accepts; the others light what these see.
    ///
    /// # Errors
    /// [`RenderError::Gpu`].
    pub fn sample(&mut self, adds: impl Fn(&str) -> bool) -> Result<(), RenderError> {
        let mut frame = Frame::new(&self.gpu, false);
        self.rays.merge(&mut frame);
        self.renderer.light_atlas(
            &mut frame,
            &self.view,
            &mut self.capture,
            |frame, capture| self.leaks.record(frame, &self.rays, capture),
            &self.targets,
            adds,
        )?;
        frame.submit()?;
        Ok(())
    }

    /// How many texels are where no light can be, and what became of them.
    ///
    /// # Errors
    /// [`RenderError::Gpu`].
    pub fn leaks(&self) -> Result<LeakReport, RenderError> {
        Ok(self.leaks.report(&self.gpu)?)
    }

    /// The mean of the samples, page by page, row by row from the top: empty texels filled from their neighbours, seams closed. Another sample
    /// must not follow.
    ///
    /// # Errors
    /// [`RenderError::Gpu`].
    pub fn finish(self) -> Result<Vec<Vec<Vec3>>, RenderError> {
        let mut image = Vec::new();
        for (target, dilation) in self.targets.iter().zip(&self.dilations) {
            let mut frame = Frame::new(&self.gpu, false);
            dilation.record(&mut frame, target)?;
            frame.submit()?;
            let radiance = &target.radiance;
            let texels: Vec<[f32; 4]> = read_buffer(&self.gpu, radiance, radiance.size())?;
            // Sums of a samples, and of texels that were filled one mean.
            let means = texels
                .into_iter()
                .map(|[r, g, b, a]| Vec3::new(r, g, b) / a.max(1.0));
            image.extend(means);
        }
        self.seams.smooth(&mut image);
        let size = self.capture.size as usize;
        let pages = image.chunks(size * size);
        Ok(pages.map(<[Vec3]>::to_vec).collect())
    }
}

/// Computes the obscurances of an atlas, page by page. `goes_on` is asked after each step, with the share of the work done, whether to go on.
///
/// # Errors
/// [`RenderError::Gpu`]; `None` when `goes_on` said no.
pub fn obscurances(
    gpu: &Gpu,
    scene: &Scene,
    atlas: &Atlas,
    settings: &obscurances::Settings,
    mut goes_on: impl FnMut(f32) -> bool,
) -> Result<Option<Vec<ObscurancePage>>, RenderError> {
    let mut on_gpu = GpuScene::with_texels(gpu, scene)?;
    let options = AtlasCaptureOptions::default();
    let mut capture = AtlasCapture::new(gpu, scene, &on_gpu, atlas, &options)?;
    let mut leaks = LeakTest::new(gpu, &on_gpu, &capture)?;
    let mut solution = obscurances::Solution::new(gpu, scene, &on_gpu, atlas, &capture, settings)?;
    loop {
        let mut frame = Frame::new(gpu, false);
        on_gpu.merge(&mut frame);
        capture.record(&mut frame, &on_gpu)?;
        leaks.record(&mut frame, &on_gpu, &capture);
        solution.record(&mut frame, &on_gpu, &capture)?;
        frame.submit()?;
        if !goes_on(solution.progress()) {
            return Ok(None);
        }
        if solution.is_done() {
            return Ok(Some(solution.pages(gpu)?));
        }
    }
}
