//! Settings of radiance transfer.

use gpugi_scene::TransferVectors;

use super::haar;
use crate::scene::Claims;

crate::choices! {
    /// Functions of the direction that light is a sum of.
    pub enum Basis {
        /// Spherical harmonics: few, smooth functions, which turn exactly.
        Harmonics = "harmonics",
        /// Haar wavelets on a cube map, of which each texel keeps the largest terms: for small, bright lights.
        Haar = "haar",
    }
}

crate::choices! {
    /// Points that have transfer vectors.
    pub enum At {
        /// The texels of an atlas.
        Texels = "texels",
        /// The vertices of all meshes.
        Vertices = "vertices",
    }
}

crate::settings! {
    /// Settings of radiance transfer.
    pub struct Settings {
        /// Points that have transfer vectors: texels, those of an atlas; vertices, those of all meshes, which need no
        /// atlas but show no shadow finer than their triangles.
        pub at: At = At::Texels => any(),
        /// At vertices, the longest distance between points along the edges of triangles: longer edges have points
        /// between their vertices, too, so that coarse meshes show shadows; 0: vertices alone.
        pub subdivide: f32 = 0.0 => in_range(0.0, 1e6).unit("m"),
        /// Functions of the direction that light is a sum of: harmonics, spherical harmonics; haar, Haar wavelets on a
        /// cube map of 64 texels per side, for small, bright lights.
        pub basis: Basis = Basis::Harmonics => any(),
        /// Largest coefficients that a texel keeps; wavelets only.
        pub coefficients: u32 = 100 => in_range(6.0, 4096.0),
        /// Bands of spherical harmonics: order * order functions.
        pub order: u32 = 6 => in_range(2.0, 8.0),
        /// Surfaces that light meets between the environment and the eye; 1 is direct light only, which radiosity
        /// can continue.
        pub bounces: u32 = 1 => in_range(1.0, 32.0),
        /// Rays per texel and bounce; powers of two are best. Wavelets trace at least one per texel of their cube, and
        /// this many for reflected light.
        pub rays: u32 = 1024 => in_range(1.0, 65_536.0),
        /// Whether directional lights are projected, too. Only in scenes without point and spot lights.
        pub directional_lights: bool = false => any(),
        /// Whether the higher bands of the light are damped until it is negative in no direction: no ringing around
        /// small lights, but softer shadows. Harmonics only.
        pub window: bool = false => any(),
        /// Objects whose glossy lobes reflect the light, too: names separated by commas, * stands for any characters.
        /// Each of their texels keeps a transfer matrix: 10 KiB for order 6. Harmonics only.
        pub glossy: String = String::new() => any(),
        /// Whether texels are clustered by their coefficients, and each keeps weights of its cluster's principal
        /// components (CPCA). Harmonics only.
        pub compressed: bool = false => any(),
        /// Most clusters of texels.
        pub clusters: u32 = 64 => in_range(1.0, 1024.0),
        /// Principal components of each cluster.
        pub components: u32 = 12 => in_range(1.0, 64.0),
        /// Least texels of a cluster; smaller ones join others.
        pub minimum: u32 = 64 => in_range(1.0, 65_536.0).unit("texels"),
        /// Side of the atlas's pages.
        pub resolution: u32 = 512 => in_range(16.0, 8192.0).unit("texels"),
        /// Texels per metre, on as many pages as needed; 0: as many texels as fit on one page.
        pub density: f32 = 0.0 => in_range(0.0, 1e6).unit("1/m"),
        /// Steps per frame; each step is 4 million rays.
        pub steps: u32 = 1 => in_range(1.0, 4096.0),
        /// Whether transfer vectors that the scene's file holds are used instead of new ones. They decide basis, order,
        /// bounces, resolution and density.
        pub stored: bool = true => any(),
        /// Seed of all random decisions.
        pub seed: u32 = 0 => in_range(0.0, 4_294_967_295.0),
    }
}

/// [`Settings::of_transfer`].
pub(super) type OfTransfer = (Basis, u32, [u32; 3], Option<[u32; 3]>);

impl Settings {
    /// Coefficients that a texel keeps.
    pub fn terms(&self) -> u32 {
        match self.basis {
            Basis::Harmonics => self.order * self.order,
            Basis::Haar => self.coefficients,
        }
    }

    /// Whether objects are chosen for glossy reflection.
    pub(super) fn is_glossy(&self) -> bool {
        !self.glossy.is_empty() && self.basis == Basis::Harmonics
    }

    /// Whether texels keep weights instead of coefficients.
    pub(super) fn is_compressed(&self) -> bool {
        self.compressed && self.basis == Basis::Harmonics
    }

    /// 32-bit words of a texel's cluster and weights, 16 bits each.
    pub(super) fn words_of_weights(&self) -> u32 {
        self.components / 2 + 1
    }

    /// 32-bit words of a cluster's mean and basis vectors.
    pub(super) fn words_of_cluster(&self) -> usize {
        2 * self.terms() as usize * (self.components as usize + 1)
    }

    /// Whether vectors of a file may be used: files hold those of texels, and no matrices.
    pub(super) fn may_be_stored(&self) -> bool {
        self.stored && self.at == At::Texels && !self.is_glossy()
    }

    /// Rays per texel and bounce.
    pub(super) fn rays_per_texel(&self) -> u32 {
        match self.basis {
            Basis::Harmonics => self.rays,
            Basis::Haar => haar::rays_per_texel(self.rays),
        }
    }

    /// What is in force if `stored` vectors are used.
    pub(super) fn with(&self, stored: Option<&TransferVectors>) -> Self {
        let mut settings = self.clone();
        if let Some(stored) = stored {
            settings.basis = Basis::Harmonics;
            settings.order = stored.order;
            settings.bounces = stored.bounces;
        }
        settings
    }

    /// Claims of other techniques on an object that leave it out. Indirect light of another technique joins direct
    /// light, but not light of several bounces.
    pub(super) fn left_out(&self) -> Claims {
        if self.bounces > 1 {
            Claims::ENVIRONMENT | Claims::INDIRECT
        } else {
            Claims::ENVIRONMENT
        }
    }

    /// What decides the transfer vectors: basis, order or coefficients, bounces, rays, seed and clusters.
    pub(super) fn of_transfer(&self) -> OfTransfer {
        let of_rays = [self.bounces, self.rays, self.seed];
        let of_clusters = [self.clusters, self.components, self.minimum];
        let of_clusters = self.is_compressed().then_some(of_clusters);
        (self.basis, self.terms(), of_rays, of_clusters)
    }
}
