//! The steps that make panes: columns of transfer, walks, near surfaces, and the light of each cluster.

use crate::capture::atlas::{AtlasCapture, AtlasPiece};
use crate::gpu::{Frame, Gpu, GpuError, Named};
use crate::scene::GpuScene;

use super::super::entries::{COLUMN, Entry};
use super::super::gpu::{RUN, Site, Work};
use super::super::{Clustering, Settings, Visibility};
use super::{COMPARED_PER_RAY, Columns, LIGHTS_PER_WALK, LOOKED_UP_PER_RAY, NEAR_BOUNCES, Panes};

impl Panes {
    /// Clusters the entry points by transfer, if that is wanted. Returns the rays of this step until that is done: the
    /// columns take a while to reach the host.
    pub(super) fn cluster(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
    ) -> Result<Option<u64>, GpuError> {
        let is_wanted = self.settings.clustering == Clustering::Transfer && self.stored.is_none();
        if !is_wanted || self.points.entries.entries.is_empty() {
            return Ok(None);
        }
        let Some(columns) = &self.columns else {
            let (columns, rays) = self.find_columns(frame, scene)?;
            self.columns = Some(columns);
            return Ok(Some(rays));
        };
        let Some(found) = columns.get() else {
            return Ok(Some(0));
        };
        self.points.cluster_by(frame.gpu, &found?);
        self.columns = None;
        Ok(None)
    }

    /// Entry points for shaders.
    fn sites(&self, gpu: &Gpu) -> Result<wgpu::Buffer, GpuError> {
        let entries = &self.points.entries;
        let site = |(entry, cluster): (&Entry, u32)| Site {
            position: entry.position.to_array(),
            cluster,
            normal: entry.normal.to_array(),
            normal_scale: entries.normal_scale,
        };
        let sites: Vec<Site> = entries.with_clusters().map(site).collect();
        gpu.storage("sites of entry points [bytes]", &sites)
    }

    /// What each entry point sends to some of the others, on its way to the host, and the number of rays: pass
    /// `light-path-map.columns`.
    fn find_columns(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
    ) -> Result<(Columns, u64), GpuError> {
        let gpu = frame.gpu;
        let count = self.points.entries.entries.len() * COLUMN;
        let bytes = count as u64 * 4;
        let columns = gpu.room("transfer [bytes]", bytes)?;
        let sites = self.sites(gpu)?;
        let own: [Named<'_>; 2] = [("sites", &sites), ("columns", &columns)];
        let kernel = (&self.kernels.columns, Some(&scene.ray_bind_group));
        let (name, work) = ("light-path-map.columns", (self.work(), &own[..]));
        self.run(frame, name, kernel, work, count as u32)?;
        let columns = frame.read_back(&columns, bytes)?;
        Ok((Box::new(columns), count as u64))
    }

    /// Entry points and their virtual lights: passes `light-path-map.entries` and `light-path-map.walks`.
    pub(super) fn walk(&self, frame: &mut Frame<'_>, scene: &GpuScene) -> Result<u64, GpuError> {
        let work = frame.gpu.constant("light path map", &self.work())?;
        self.points.resolve(frame, scene, &work)?;
        if self.stored.is_some() {
            return Ok(0);
        }
        frame.clear(&self.lights);
        let kernel = (&self.kernels.walks, Some(&scene.ray_bind_group));
        let count = self.points.entries.entries.len() as u32 * self.settings.walks;
        let (name, work) = ("light-path-map.walks", (self.work(), &[][..]));
        self.run(frame, name, kernel, work, count)?;
        Ok(u64::from(count) * LIGHTS_PER_WALK)
    }

    /// Parameters of a tile, and its piece.
    fn tile<'a>(&self, capture: &'a AtlasCapture, tile: usize) -> (Work, &'a AtlasPiece) {
        let (piece, points) = &self.tiles[tile];
        let piece = &capture.pieces()[*piece];
        let work = Work {
            first_texel: piece.rows.start * self.size,
            first_point: points.start,
            end_point: points.end,
            ..self.work()
        };
        (work, piece)
    }

    /// Clusters and near surfaces of a tile's texels: passes `light-path-map.owners` and `light-path-map.near`.
    pub(super) fn find_near(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        capture: &AtlasCapture,
        tile: usize,
    ) -> Result<u64, GpuError> {
        let (work, piece) = self.tile(capture, tile);
        let count = work.end_point - work.first_point;
        let sites = self.sites(frame.gpu)?;
        let own: [Named<'_>; 2] = [("points", &piece.points.points), ("sites", &sites)];
        let (name, owners) = ("light-path-map.owners", (&self.kernels.owners, None));
        self.run(frame, name, owners, (work, &own), count)?;
        let compared = self.points.entries.entries.len() as u64 / COMPARED_PER_RAY;
        if self.stored.is_some() {
            return Ok(u64::from(count) * compared);
        }
        let near = (&self.kernels.near, Some(&scene.ray_bind_group));
        self.run(frame, "light-path-map.near", near, (work, &own), count)?;
        let rays = u64::from(self.settings.near_rays);
        Ok(u64::from(count) * (rays + compared))
    }

    /// Light of a cluster's virtual lights at a tile's texels: pass `light-path-map.light`, after
    /// `light-path-map.depth-maps` if these tell what is visible.
    pub(super) fn light(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        capture: &AtlasCapture,
        cluster: u32,
        tile: usize,
    ) -> Result<u64, GpuError> {
        let (of_tile, piece) = self.tile(capture, tile);
        let count = of_tile.end_point - of_tile.first_point;
        let firsts = &self.points.entries.firsts;
        let [first, end] = [0, 1].map(|next| firsts[cluster as usize + next]);
        let batches = (end - first).div_ceil(self.mapped_at_once).max(1);
        let mut rays = 0;
        for batch in 0..batches {
            let first_entry = first + batch * self.mapped_at_once;
            let work = Work {
                cluster,
                first_entry,
                end_entry: end.min(first_entry.saturating_add(self.mapped_at_once)),
                continues: (batch > 0).into(),
                ..of_tile
            };
            // Maps that are all there serve the tiles that follow, too.
            if self.settings.visibility == Visibility::Maps && (tile == 0 || batches > 1) {
                rays += self.map_depths(frame, scene, work)?;
            }
            let own: [Named<'_>; 1] = [("points", &piece.points.points)];
            let light = (&self.kernels.light, Some(&scene.ray_bind_group));
            self.run(frame, "light-path-map.light", light, (work, &own), count)?;
        }
        let per_light = match self.settings.visibility {
            Visibility::Rays => u64::from(count),
            Visibility::Maps => u64::from(count) / LOOKED_UP_PER_RAY,
        };
        Ok(rays + per_light * u64::from(end - first) * self.lights_per_entry())
    }

    /// Virtual lights of an entry point, roughly.
    fn lights_per_entry(&self) -> u64 {
        1 + LIGHTS_PER_WALK * u64::from(self.settings.walks)
    }

    /// Depth maps of the virtual lights of some entry points, and the number of rays, roughly: pass
    /// `light-path-map.depth-maps`.
    fn map_depths(
        &self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        work: Work,
    ) -> Result<u64, GpuError> {
        let entries = work.end_entry - work.first_entry;
        let texels = work.map_resolution * work.map_resolution;
        let slots = entries * (1 + work.walks * work.depth);
        let kernel = (&self.kernels.depth_maps, Some(&scene.ray_bind_group));
        let (name, invocations) = ("light-path-map.depth-maps", slots * texels.div_ceil(RUN));
        self.run(frame, name, kernel, (work, &[]), invocations)?;
        Ok(u64::from(entries) * self.lights_per_entry() * u64::from(texels))
    }

    /// Adds the light of near surfaces and stores the pane: passes `light-path-map.add-near` and
    /// `light-path-map.store`.
    pub(super) fn finish_pane(&self, frame: &mut Frame<'_>, pane: u32) -> Result<(), GpuError> {
        let mut before = &self.lit[0];
        let bounces = match self.settings.depth {
            Settings::DEEPEST => NEAR_BOUNCES,
            _ => 1,
        };
        for bounce in 0..bounces {
            let after = &self.lit[1 + bounce as usize % 2];
            let own: [Named<'_>; 2] = [("before", before), ("after", after)];
            let (name, add_near) = ("light-path-map.add-near", (&self.kernels.add_near, None));
            self.run(frame, name, add_near, (self.work(), &own), self.texels)?;
            before = after;
        }
        self.store(frame, pane, before)
    }
}
