//! Settings of light path maps.

use gpugi_scene::LightPathPanes;
use gpugi_scene::panes::ANY_DEPTH;

crate::choices! {
    /// Which entry points form a cluster.
    pub enum Clustering {
        /// Those that lie near each other and face alike.
        Kmeans = "kmeans",
        /// Those that send light to the same places.
        Transfer = "transfer",
    }
}

crate::choices! {
    /// How it is found which texels a virtual light sees.
    pub enum Visibility {
        /// By a shadow ray from each texel.
        Rays = "rays",
        /// By a depth map of the light's hemisphere.
        Maps = "maps",
    }
}

crate::choices! {
    /// What a texel of a pane takes.
    pub enum Store {
        /// 4 bytes: three channels with a shared exponent.
        Rgb9e5 = "rgb9e5",
        /// 8 bytes: three 16-bit floats, padded.
        Half = "half",
        /// 1 byte: blocks of 4 x 4 texels, with two colours and what lies between them.
        Bc6h = "bc6h",
    }
}

impl Store {
    /// 32-bit words that hold a texel; a block of BC6H holds 16. `WORDS` of sum.wesl.
    pub(super) fn words(self) -> u32 {
        match self {
            Self::Rgb9e5 => 1,
            Self::Half => 2,
            Self::Bc6h => 4,
        }
    }

    /// Words of a pane (texels), or blocks.
    pub(super) fn stored(self, [width, height]: [u32; 2]) -> u32 {
        match self {
            Self::Bc6h => width.div_ceil(4) * height.div_ceil(4) * self.words(),
            _ => width * height * self.words(),
        }
    }
}

crate::settings! {
    /// Settings of light path maps.
    pub struct Settings {
        /// Points, spread evenly over the surfaces, at which direct light enters.
        pub entries: u32 = 4096 => in_range(16.0, 16_384.0),
        /// Points per entry point at which the light is sampled, the entry point included.
        pub light_samples: u32 = 8 => in_range(1.0, 16.0),
        /// Random walks from each entry point.
        pub walks: u32 = 2 => in_range(1.0, 16.0),
        /// Most surfaces that a walk visits after its entry point; 0: light of one reflection only.
        pub depth: u32 = 32 => in_range(0.0, 32.0),
        /// Clusters of entry points, and panes.
        pub clusters: u32 = 256 => in_range(1.0, 1024.0),
        /// Which entry points form a cluster: kmeans, those near each other that face alike; transfer, those that send
        /// light to the same places.
        pub clustering: Clustering = Clustering::Kmeans => any(),
        /// Most panes that are added in a tile of 8 x 8 texels whenever the light changes, those that matter most there;
        /// the rest shares one. 0: all.
        pub panes: u32 = 0 => in_range(0.0, 1024.0),
        /// Part of a tile's light that may be in the wrong place in it, for fewer panes.
        pub left_out: f32 = 0.005 => in_range(0.0, 1.0),
        /// How it is found which texels a virtual light sees: rays, by a shadow ray from each texel; maps, by a depth map
        /// of the light's hemisphere.
        pub visibility: Visibility = Visibility::Rays => any(),
        /// Side of these depth maps.
        pub map_resolution: u32 = 64 => in_range(8.0, 128.0).unit("texels"),
        /// Short rays per texel, for the light of near surfaces.
        pub near_rays: u32 = 32 => in_range(1.0, 256.0),
        /// Side of the atlas's pages.
        pub resolution: u32 = 256 => in_range(16.0, 8192.0).unit("texels"),
        /// Texels per metre, on as many pages as needed; 0: as many texels as fit on one page.
        pub density: f32 = 0.0 => in_range(0.0, 1e6).unit("1/m"),
        /// How panes are stored: rgb9e5, three channels with a shared exponent in 4 bytes per texel; half, 16-bit floats
        /// in 8 bytes; bc6h, compressed to 1 byte.
        pub store: Store = Store::Rgb9e5 => any(),
        /// Steps per frame; each step is about 4 million rays.
        pub steps: u32 = 4 => in_range(1.0, 4096.0),
        /// Whether panes that the scene's file holds are used instead of new ones. They decide all that panes are made
        /// with.
        pub stored: bool = true => any(),
        /// Seed of all random decisions.
        pub seed: u32 = 0 => in_range(0.0, 4_294_967_295.0),
    }
}

impl Settings {
    /// The largest `depth`, which stands for light paths of any length.
    pub(super) const DEEPEST: u32 = ANY_DEPTH;

    /// What is in force if `stored` panes are used.
    pub(super) fn with(&self, stored: Option<&LightPathPanes>) -> Self {
        let mut settings = self.clone();
        if let Some(stored) = stored {
            let entries = stored.entries.len().max(1);
            settings.entries = entries as u32;
            settings.light_samples = 1 + (stored.samples.len() / entries) as u32;
            settings.clusters = stored.clusters() as u32;
            settings.depth = stored.depth;
            settings.clustering = Clustering::Kmeans;
            settings.store = Store::Rgb9e5;
            // No ray is traced.
            settings.visibility = Visibility::Rays;
            settings.walks = 1;
            settings.near_rays = 1;
        }
        settings
    }

    /// What decides the panes: the rest says how they are added, and how fast they are made.
    pub(super) fn of_panes(&self) -> Self {
        Self {
            panes: 0,
            left_out: 0.0,
            steps: 1,
            ..self.clone()
        }
    }
}
