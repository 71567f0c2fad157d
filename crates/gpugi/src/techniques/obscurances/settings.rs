//! Settings of obscurances.

crate::choices! {
    /// How obscurances are sampled.
    pub enum Mode {
        /// Rays from every texel. Needs a scene with rays ([`crate::scene::GpuScene::with_rays`]).
        Rays = "rays",
        /// Bundles of parallel lines through the whole scene, hit by hit. Needs a scene for captures
        /// ([`crate::scene::GpuScene::new`]).
        Peeling = "peeling",
    }
}

crate::choices! {
    /// How much ambient light comes from a surface at distance d: rho(d), 1 beyond the reach.
    pub enum Falloff {
        /// Square root of d over the reach.
        Sqrt = "sqrt",
        /// d over the reach.
        Linear = "linear",
        /// 0 within the reach: plain ambient occlusion.
        Step = "step",
    }
}

crate::choices! {
    /// The ambient light that obscurances attenuate.
    pub enum Ambient {
        /// None: obscurances are only maps, and add no light.
        Off = "off",
        /// Equation 25 with W.
        Plain = "plain",
        /// Equation 25 with colored W.
        Colored = "colored",
        /// Equation 25 with W = 1: the same everywhere, as in local illumination.
        Constant = "constant",
    }
}

crate::settings! {
    /// Settings of obscurances.
    pub struct Settings {
        /// How obscurances are sampled: rays (from every texel) or peeling (bundles of lines, hit by hit).
        pub mode: Mode = Mode::Rays => any(),
        /// Reach: surfaces farther away do not obscure.
        pub distance: f32 = 1.0 => in_range(1e-6, 1e9).unit("m"),
        /// How the effect of nearer surfaces depends on distance: sqrt, linear or step (plain ambient occlusion).
        pub falloff: Falloff = Falloff::Sqrt => any(),
        /// Whether obscurances with the colours of the obscuring surfaces are computed, too.
        pub colored: bool = true => any(),
        /// Rays per texel, or bundles of lines; powers of two are best.
        pub directions: u32 = 512 => in_range(1.0, 65_536.0),
        /// Most surfaces that a line hits (peeling).
        pub layers: u32 = 32 => in_range(1.0, 1024.0),
        /// Lines of a bundle, along each axis, across a texel of mean size that faces them (peeling).
        pub lines: f32 = 1.0 => in_range(0.1, 8.0),
        /// Most lines of a bundle along each axis (peeling).
        pub most_lines: u32 = 2048 => in_range(16.0, 8192.0),
        /// Seed of all random decisions.
        pub seed: u32 = 0 => in_range(0.0, 4_294_967_295.0),
        /// Ambient term, the indirect light of closed scenes: off, plain, colored, or constant, which nothing obscures.
        pub ambient: Ambient = Ambient::Off => any(),
        /// Ambient radiance; 0: that of a closed scene with the lights that other techniques add.
        pub ambient_radiance: f32 = 0.0 => in_range(0.0, 1e9).unit("W/sr/m^2"),
        /// Side of the pages of the atlas that a renderer lays out.
        pub resolution: u32 = 512 => in_range(16.0, 8192.0).unit("texels"),
        /// Texels per metre of that atlas, on as many pages as needed; 0: as many texels as fit on one page.
        pub density: f32 = 0.0 => in_range(0.0, 1e6).unit("1/m"),
        /// Steps that a renderer takes per frame; each step is 4 million rays or one bundle.
        pub steps: u32 = 1 => in_range(1.0, 4096.0),
    }
}

impl Settings {
    /// Whether the ambient light derives from the direct light of the scene.
    pub(super) fn sums_light(&self) -> bool {
        self.ambient != Ambient::Off && self.ambient_radiance == 0.0
    }
}
