//! Settings of radiance transfer.

use gpugi_scene::TransferVectors;

use crate::scene::Claims;

crate::settings! {
    /// Settings of radiance transfer.
    pub struct Settings {
        /// Bands of spherical harmonics: order * order functions.
        pub order: u32 = 6 => in_range(2.0, 8.0),
        /// Surfaces that light meets between the environment and the eye; 1 is direct light only, which radiosity
        /// can continue.
        pub bounces: u32 = 1 => in_range(1.0, 32.0),
        /// Rays per texel and bounce; powers of two are best.
        pub rays: u32 = 1024 => in_range(1.0, 65_536.0),
        /// Whether directional lights are projected, too. Only in scenes without point and spot lights.
        pub directional_lights: bool = false => any(),
        /// Whether the higher bands of the light are damped until it is negative in no direction: no ringing around
        /// small lights, but softer shadows.
        pub window: bool = false => any(),
        /// Side of the atlas's pages.
        pub resolution: u32 = 512 => in_range(16.0, 8192.0).unit("texels"),
        /// Texels per metre, on as many pages as needed; 0: as many texels as fit on one page.
        pub density: f32 = 0.0 => in_range(0.0, 1e6).unit("1/m"),
        /// Steps per frame; each step is 4 million rays.
        pub steps: u32 = 1 => in_range(1.0, 4096.0),
        /// Whether transfer vectors that the scene's file holds are used instead of new ones. They decide order, bounces,
        /// resolution and density.
        pub stored: bool = true => any(),
        /// Seed of all random decisions.
        pub seed: u32 = 0 => in_range(0.0, 4_294_967_295.0),
    }
}

impl Settings {
    /// Functions, and coefficients per texel.
    pub fn functions(&self) -> u32 {
        self.order * self.order
    }

    /// What is in force if `stored` vectors are used.
    pub(super) fn with(&self, stored: Option<&TransferVectors>) -> Self {
        let mut settings = self.clone();
        if let Some(stored) = stored {
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

    /// What decides the transfer vectors: order, bounces, rays and seed.
    pub(super) fn of_transfer(&self) -> [u32; 4] {
        [self.order, self.bounces, self.rays, self.seed]
    }
}
