//! The default techniques, chosen by the purpose of the light, by the scene and by the kind of adapter. The clock plays
//! no part, so a scene gets the same set on all adapters of a kind.

use std::collections::BTreeSet;

use gpugi_scene::{Light, LightKind, Material, Scene};

use crate::gpu::{AdapterSummary, GpuError};
use crate::light_paths::{LightClass, LightPaths, overlap};
use crate::lighting::LightingError;
use crate::scene::{emit_light, has_emitters, has_glossy_objects, stand_apart};
use crate::techniques::{
    Info, Registry, caustics, distance_impostor, final_gather, image_based_lighting,
    participating_media, radiosity, ray_tracing, shadow_map,
};

const CAUSTICS: &str = caustics::INFO.name;
const IMPOSTORS: &str = distance_impostor::INFO.name;
const RAY_TRACING: &str = ray_tracing::INFO.name;
const RADIOSITY: &str = radiosity::INFO.name;
const SHADOWS: &str = shadow_map::INFO.name;
const SKY: &str = image_based_lighting::INFO.name;
const FINAL_GATHER: &str = final_gather::INFO.name;
const MEDIA: &str = participating_media::INFO.name;

/// A still picture of more distinct triangles than this does not wait for an atlas by default: instances share the
/// unwrapping of their mesh. Unwrapping 94,722 triangles takes 2 to 3 s on two cores, unwrapping 145,917 takes 8 s
/// (docs/atlas.md).
const MOST_UNWRAPPED: u64 = 100_000;

/// Nor does one of more triangles in all instances than this: each has texels of its own.
const MOST_IN_TEXELS: u64 = 250_000;

/// Meshes of more connected pieces than this, such as foliage, are not unwrapped by default: each piece takes a chart
/// with its gutter, which fill the pages, and packing them takes a minute for 20,000.
const MOST_PIECES: usize = 4_000;

/// A still picture of more triangles than this looks into cubes instead of tracing rays: the smallest bindings that
/// WebGPU promises hold the hierarchy of two million (docs/bvh.md).
const MOST_TRACED: u64 = 1_000_000;

/// The setting of image-based-lighting that [`DefaultSet::trace_sky_light`] makes.
const VISIBILITY: &str = "visibility";

/// What light is computed for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// One picture of a scene that stands still. It may wait seconds for its maps
    /// ([`Renderer::converge`](crate::Renderer::converge)).
    StillPicture,
    /// Frames in motion. Each is due within milliseconds, and nothing may stall it.
    LiveView,
    /// Light that is stored in textures. It may take minutes.
    Bake,
}

/// A technique of a set.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// Name of the technique.
    pub technique: &'static str,
    /// Why it is in the set, in a few words.
    pub reason: String,
    /// Settings that differ from their defaults: names, and values as text.
    pub settings: Vec<(&'static str, String)>,
}

/// A set of techniques.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DefaultSet {
    /// The techniques.
    pub choices: Vec<Choice>,
    /// Why the set is not the first choice: one sentence each.
    pub notes: Vec<String>,
}

impl DefaultSet {
    /// Names of the techniques.
    pub fn names(&self) -> Vec<String> {
        let choices = self.choices.iter();
        choices.map(|one| one.technique.to_owned()).collect()
    }

    /// The set with final-gather in place of the technique that `error` says has no atlas, which only the attempt to
    /// unwrap the scene tells; `None` if it is another error.
    pub fn without_atlas(mut self, error: &LightingError) -> Option<Self> {
        let LightingError::Gpu(GpuError::Pass { pass, .. }) = error else {
            return None;
        };
        let at = self.choices.iter().position(|one| one.technique == pass)?;
        self.choices[at] = Choice {
            technique: FINAL_GATHER,
            reason: "it needs no atlas".into(),
            settings: Vec::new(),
        };
        self.notes
            .push(format!("{FINAL_GATHER} stands in for {error}"));
        if !self.has_rays() {
            for choice in &mut self.choices {
                choice.settings.retain(|(name, _)| *name != VISIBILITY);
            }
        }
        Some(self)
    }

    /// Whether scenes are uploaded with rays for the techniques.
    fn has_rays(&self) -> bool {
        let mut choices = self.choices.iter();
        choices.any(|one| [RADIOSITY, RAY_TRACING].contains(&one.technique))
    }

    /// Has rays find the shadows of the sky, if other techniques trace rays anyway. They are exact, where depth maps
    /// blur whatever is thin and leak at edges. Not among solids of glass: each ray passes many surfaces there, and takes
    /// four times as long as maps with their drawing (docs/techniques/image-based-lighting.md).
    fn trace_sky_light(&mut self) {
        let has_rays = self.has_rays();
        let mut choices = self.choices.iter_mut();
        if let Some(sky) = choices.find(|one| has_rays && one.technique == SKY) {
            sky.settings.push((VISIBILITY, "rays".to_owned()));
        }
    }
}

/// The set for `purpose` on `adapter`, of the techniques in `registry`:
///
/// - for every purpose, the techniques that suit the scene and are fast enough for a live view: direct light, and what
///   mirrors and glass make of it;
/// - for a still picture, also what rough surfaces reflect of lit surroundings;
/// - indirect light between diffuse surfaces.
pub fn default_set(
    scene: &Scene,
    adapter: &AdapterSummary,
    purpose: Purpose,
    registry: &Registry,
) -> DefaultSet {
    let classes = light_classes(scene);
    let triangles = scene.statistics().triangles;
    let of_classes = |paths: &&LightPaths| classes.contains(&paths.class);
    let infos = registry.all().iter().map(|one| one.info);
    let fast: Vec<&Info> = infos
        .filter(|info| info.paths.iter().any(|paths| of_classes(&paths)) && (info.suits)(scene))
        // Media are seen from somewhere; texels are not.
        .filter(|info| info.name != MEDIA || purpose != Purpose::Bake)
        .collect();
    let choices = fast.iter().map(|info| Choice {
        technique: info.name,
        reason: reason(info, &classes),
        settings: match (info.name, purpose) {
            (SHADOWS, Purpose::StillPicture) => soft_shadows(scene, adapter),
            // Where a picture soon has more samples, a quarter of each one's work is enough.
            (SHADOWS, Purpose::LiveView) if has_emitters(scene) => {
                vec![("interleaved", true.to_string())]
            }
            (SKY, Purpose::StillPicture) => sky(triangles, Speed::of(adapter)),
            (CAUSTICS, Purpose::StillPicture) => photons(Speed::of(adapter)),
            // Surfaces in fog would be lit by few bright rays: dots, unless there are very many samples.
            (MEDIA, Purpose::StillPicture) if stand_apart(scene) => {
                vec![("light-surfaces", 4.to_string())]
            }
            _ => Vec::new(),
        },
    });
    let mut set = DefaultSet {
        choices: choices.collect(),
        notes: Vec::new(),
    };
    if classes.is_empty() {
        return set;
    }
    if purpose == Purpose::StillPicture
        && has_glossy_objects(scene)
        && registry.find(RAY_TRACING).is_some()
    {
        let is_other = |one: &Choice| one.technique != IMPOSTORS;
        set.choices.retain(is_other);
        set.choices.push(gloss(scene, triangles));
    }
    let paths = fast.iter().flat_map(|info| info.paths).filter(of_classes);
    let paths: Vec<LightPaths> = paths.cloned().collect();
    let is_added = overlap(&paths, radiosity::INFO.paths).is_some();
    let choice = indirect(scene, adapter, purpose);
    if registry.find(choice.technique).is_some() && !is_added {
        set.choices.push(choice);
    }
    let is_fast = Speed::of(adapter) == Speed::Fast;
    let is_solid_glass = |one: &Material| one.transmission > 0.0 && one.volume.is_some();
    let has_solid_glass = scene.materials.iter().any(is_solid_glass);
    if purpose == Purpose::StillPicture && is_fast && triangles <= MOST_TRACED && !has_solid_glass {
        set.trace_sky_light();
    }
    set
}

/// The technique for indirect light between diffuse surfaces.
fn indirect(scene: &Scene, adapter: &AdapterSummary, purpose: Purpose) -> Choice {
    let triangles = scene.statistics().triangles;
    if purpose == Purpose::Bake {
        return Choice {
            technique: RADIOSITY,
            reason: "texels are laid out for the bake".into(),
            settings: Vec::new(),
        };
    }
    if purpose == Purpose::LiveView {
        // Light in an atlas is noisy while things move, and whenever meshes change the frame waits for another atlas.
        // One of eight reference points, drawn per pixel, takes a third of the time of all.
        return Choice {
            technique: FINAL_GATHER,
            reason: "it follows what moves, without an atlas".into(),
            settings: vec![("blend", "drawn".to_owned())],
        };
    }
    let Unwrapped {
        triangles: distinct,
        pieces,
    } = Unwrapped::of(scene);
    if distinct <= MOST_UNWRAPPED && triangles <= MOST_IN_TEXELS && pieces <= MOST_PIECES {
        return Choice {
            technique: RADIOSITY,
            reason: format!("nothing moves, and {distinct} triangles are soon unwrapped"),
            settings: radiosity_sizes(triangles, Speed::of(adapter)),
        };
    }
    let why = if triangles > MOST_IN_TEXELS {
        format!("texels for {triangles} triangles take long")
    } else {
        format!("unwrapping {distinct} triangles in {pieces} pieces takes long")
    };
    Choice {
        technique: FINAL_GATHER,
        reason: format!("it needs no atlas, and {why}"),
        settings: Vec::new(),
    }
}

/// Reflections and refractions of everything glossy in a still picture: its samples share the work of wide lobes. Rays are
/// more exact than distance-impostor, and faster: cubes would light many more points than a picture shows.
fn gloss(scene: &Scene, triangles: u64) -> Choice {
    let objects = ("objects", "*".to_owned());
    let reason = "surfaces reflect or refract their surroundings";
    if triangles > MOST_TRACED {
        return Choice {
            technique: IMPOSTORS,
            reason: format!("{reason}, and {triangles} triangles are too many for rays"),
            settings: vec![objects, ("lobes", "drawn".to_owned())],
        };
    }
    let mut settings = vec![objects];
    if scene.materials.iter().any(|one| one.transmission > 0.0) {
        // Both what glass reflects and what it refracts, at its front and back: pictures of few samples have no grain.
        settings.push(("split", 2.to_string()));
    }
    Choice {
        technique: RAY_TRACING,
        reason: reason.into(),
        settings,
    }
}

/// Settings of shadow-map for a still picture, whose samples share the work of soft shadows. A discrete GPU draws larger
/// depth maps; in software, where each point of an area light takes long, half as many serve each sample.
fn soft_shadows(scene: &Scene, adapter: &AdapterSummary) -> Vec<(&'static str, String)> {
    let has_emitters = has_emitters(scene);
    let is_soft = has_emitters || scene.lights.iter().any(|light| light.radius > 0.0);
    let mut settings = Vec::new();
    let mut set = |name, value: u32| settings.push((name, value.to_string()));
    match Speed::of(adapter) {
        Speed::Software if has_emitters => set("area-samples", 32),
        Speed::Fast => {
            if let Some([resolution, area_resolution]) = depth_maps(scene, has_emitters) {
                set("resolution", resolution);
                set("area-resolution", area_resolution);
            }
        }
        Speed::Software | Speed::Modest => {}
    }
    if is_soft {
        settings.push(("per-sample", true.to_string()));
    }
    settings
}

/// Settings of image-based-lighting for a still picture, each of whose samples is lit from directions of its own. Where
/// software would draw their depth maps for a second or more per sample, these have half as many texels per side.
fn sky(triangles: u64, speed: Speed) -> Vec<(&'static str, String)> {
    /// Most triangles whose depth maps of 512 texels per side are soon drawn in software.
    const FEW: u64 = 5_000;
    let mut settings = vec![("per-sample", true.to_string())];
    if speed == Speed::Software && triangles > FEW {
        settings.push(("resolution", 256.to_string()));
    }
    settings
}

/// Settings of caustics for a still picture. In software, which takes long to splat photons, cubes have half as many
/// texels per side; their error is the same (docs/techniques/caustics.md).
fn photons(speed: Speed) -> Vec<(&'static str, String)> {
    match speed {
        Speed::Software => vec![("cube-resolution", 128.to_string())],
        Speed::Modest | Speed::Fast => Vec::new(),
    }
}

/// Sides of depth maps, of lights and of area samples, that all fit in the largest atlas.
fn depth_maps(scene: &Scene, has_emitters: bool) -> Option<[u32; 2]> {
    /// Texels of the atlas (8192 x 8192), less what gaps between maps may take.
    const ROOM: u64 = 60 << 20;
    /// Samples of area lights, each with the half of a cube, which has the area of three faces.
    const SAMPLES: u64 = 64;
    let faces_of = |light: &Light| match light.kind {
        LightKind::Point => 6,
        LightKind::Spot { .. } => 1,
        // Cascades, and one map of the whole scene.
        LightKind::Directional => 5,
    };
    let faces: u64 = scene.lights.iter().map(faces_of).sum();
    let area_faces = if has_emitters { 3 * SAMPLES } else { 0 };
    let texels = |faces: u64, side: u32| faces * u64::from(side).pow(2);
    [[2048, 512], [2048, 384], [1024, 384]]
        .into_iter()
        .find(|&[side, area_side]| texels(faces, side) + texels(area_faces, area_side) <= ROOM)
}

/// What an atlas has to unwrap: the meshes in use, each once.
struct Unwrapped {
    triangles: u64,
    /// Connected pieces.
    pieces: usize,
}

impl Unwrapped {
    fn of(scene: &Scene) -> Self {
        let used = scene.instances.iter().map(|instance| instance.mesh);
        let used: BTreeSet<usize> = used.collect();
        let meshes = || used.iter().map(|&mesh| &scene.meshes[mesh]);
        Self {
            triangles: meshes().map(|mesh| mesh.indices.len() as u64 / 3).sum(),
            pieces: meshes().map(|mesh| mesh.pieces()).sum(),
        }
    }
}

/// Sizes of radiosity for a still picture: pages large enough for a dozen texels per triangle. On a discrete GPU, finer
/// texels and more iterates still take a second or two. In software, where rays take most of the time, coarser texels
/// get more iterates, since noise shows before blur does: from 256 texels per side on, three texels per triangle will
/// do. So many triangles are those of instances, whose gutters fill several pages however coarse texels are: larger
/// pages have finer texels for the same gutters.
fn radiosity_sizes(triangles: u64, speed: Speed) -> Vec<(&'static str, String)> {
    let side_for = |texels: u64| (texels * triangles).isqrt().next_power_of_two();
    let side = side_for(12);
    let (resolution, iterations) = match speed {
        Speed::Software => {
            let most = if triangles > MOST_UNWRAPPED {
                1024
            } else {
                512
            };
            let side = side.clamp(128, side_for(3).clamp(256, most));
            (side, 128 * 128 / side)
        }
        Speed::Modest => (side.clamp(512, 1024), 256),
        Speed::Fast => (1024, 384),
    };
    // Nobody watches the iterates: more per frame save the overhead of frames.
    [
        ("resolution", resolution),
        ("iterations", iterations),
        ("steps", 16),
    ]
    .map(|(name, value)| (name, value.to_string()))
    .to_vec()
}

/// Why a technique suits the scene.
fn reason(info: &Info, classes: &[LightClass]) -> String {
    let added = |class: &&LightClass| info.paths.iter().any(|paths| paths.class == **class);
    let lights: Vec<String> = classes
        .iter()
        .filter(added)
        .map(LightClass::to_string)
        .collect();
    let and = match info.name {
        CAUSTICS | IMPOSTORS => ", and mirrors or glass",
        MEDIA => ", and media",
        _ => "",
    };
    format!("the scene has lights ({}){and}", lights.join(", "))
}

/// What the kind of an adapter promises.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Speed {
    /// A processor.
    Software,
    /// A GPU that shares the processor's memory, or one of which nothing is known, as in browsers.
    Modest,
    /// A GPU with memory of its own.
    Fast,
}

impl Speed {
    fn of(adapter: &AdapterSummary) -> Self {
        match adapter.device_type {
            wgpu::DeviceType::Cpu => Self::Software,
            wgpu::DeviceType::DiscreteGpu => Self::Fast,
            _ => Self::Modest,
        }
    }
}

/// Classes of light that a scene has.
fn light_classes(scene: &Scene) -> Vec<LightClass> {
    let is_present = |class: &LightClass| match class {
        LightClass::Punctual => !scene.lights.is_empty(),
        LightClass::Area => has_emitters(scene) || emit_light(&scene.media),
        LightClass::Environment => scene.environment.is_some(),
    };
    LightClass::ALL.into_iter().filter(is_present).collect()
}

#[cfg(test)]
mod tests {
    use glam::{Mat4, Vec3};
    use gpugi_scene::Mesh;
    use gpugi_scene::builtin::{SCENES, builtin};

    use super::*;
    use crate::Renderer;
    use crate::light_paths::in_words;
    use crate::testing::test_gpu;

    /// What each scene has for a still picture beside shadow-map and radiosity.
    #[test]
    fn sets_are_valid_and_hold_indirect_light_in_every_scene() {
        let Some(gpu) = test_gpu() else { return };
        let registry = Registry::default();
        for one in SCENES {
            let scene = builtin(one.name, 1).unwrap();
            let set = |purpose| default_set(&scene, &gpu.adapter, purpose, &registry);
            let [still, live, bake] =
                [Purpose::StillPicture, Purpose::LiveView, Purpose::Bake].map(set);
            assert!(still.notes.is_empty(), "{}: {:?}", one.name, still.notes);
            let (gather, direct) = live.choices.split_last().unwrap();
            for one in direct {
                let is_shared = one.technique == SHADOWS && has_emitters(&scene);
                let names: Vec<&str> = one.settings.iter().map(|(name, _)| *name).collect();
                let expected: &[&str] = if is_shared { &["interleaved"] } else { &[] };
                assert_eq!(names, expected, "{}: {}", scene.name, one.technique);
            }
            assert_eq!(gather.technique, FINAL_GATHER);
            let mut expected = live.names();
            *expected.last_mut().unwrap() = RADIOSITY.to_owned();
            let has_media = expected.contains(&MEDIA.to_owned());
            assert_eq!(has_media, !scene.media.is_empty(), "{}", one.name);
            let in_texels = expected.iter().filter(|name| *name != MEDIA);
            assert_eq!(bake.names(), in_texels.cloned().collect::<Vec<_>>());
            if has_glossy_objects(&scene) {
                expected.retain(|name| name != IMPOSTORS);
                expected.insert(expected.len() - 1, RAY_TRACING.to_owned());
            }
            assert_eq!(still.names(), expected);
            let has_settings = |name| {
                let choice = still.choices.iter().find(|one| one.technique == name);
                choice.is_some_and(|one| !one.settings.is_empty())
            };
            let is_soft = has_emitters(&scene) || scene.lights.iter().any(|one| one.radius > 0.0);
            let is_fast = Speed::of(&gpu.adapter) == Speed::Fast;
            assert!(is_fast || has_settings(SHADOWS) == is_soft);
            assert_eq!(has_settings(SKY), scene.environment.is_some());
            assert_eq!(has_settings(RAY_TRACING), has_glossy_objects(&scene));
            assert_eq!(has_settings(MEDIA), has_media && stand_apart(&scene));
            // Refused if light paths overlap, or if a setting does not exist.
            let size = [8, 8];
            let renderer = Renderer::with_set(&gpu, &scene, size, &still, &registry).unwrap();
            let classes = renderer.light_classes();
            assert_eq!(classes, light_classes(&scene), "{}", one.name);
            let words = in_words(&renderer.light_paths(), &classes);
            let is_told = |what: &str| words.iter().any(|one| one.starts_with(what));
            assert!(is_told("direct light on diffuse surfaces"), "{words:?}");
            assert!(
                is_told("light reflected between diffuse surfaces"),
                "{words:?}"
            );
            let objects = &renderer.scene().objects;
            let is_smooth = objects.iter().any(|object| object.is_smooth);
            let is_rough = objects
                .iter()
                .any(|object| !object.is_smooth && !object.is_diffuse);
            for (what, is_there) in [("mirrors", is_smooth), ("gloss", is_rough)] {
                let words_of = format!("lit surroundings seen in {what}");
                assert_eq!(is_told(&words_of), is_there, "{}: {words:?}", one.name);
            }
        }
    }

    #[test]
    fn sizes_depend_on_triangles_and_kind_of_adapter_alone() {
        let sizes = |triangles, speed| {
            let sizes = radiosity_sizes(triangles, speed);
            [0, 1].map(|at| sizes[at].1.parse::<u32>().unwrap())
        };
        assert_eq!(sizes(1, Speed::Software), [128, 128]);
        assert_eq!(sizes(1_500, Speed::Software), [256, 64]);
        assert_eq!(sizes(20_000, Speed::Software), [256, 64]);
        assert_eq!(sizes(MOST_UNWRAPPED, Speed::Software), [512, 32]);
        assert_eq!(sizes(MOST_IN_TEXELS, Speed::Software), [1024, 16]);
        assert_eq!(sizes(1, Speed::Modest), [512, 256]);
        assert_eq!(sizes(MOST_UNWRAPPED, Speed::Modest), [1024, 256]);
        assert_eq!(sizes(1, Speed::Fast), [1024, 384]);
        assert_eq!(sizes(MOST_UNWRAPPED, Speed::Fast), [1024, 384]);
    }

    #[test]
    fn software_makes_smaller_maps() {
        let names = |settings: Vec<(&'static str, String)>| {
            let names = settings.into_iter().map(|(name, _)| name);
            names.collect::<Vec<_>>()
        };
        let many = 13_568;
        assert_eq!(
            names(sky(many, Speed::Software)),
            ["per-sample", "resolution"]
        );
        assert_eq!(names(sky(600, Speed::Software)), ["per-sample"]);
        assert_eq!(names(sky(many, Speed::Fast)), ["per-sample"]);
        assert_eq!(names(photons(Speed::Software)), ["cube-resolution"]);
        assert!(photons(Speed::Fast).is_empty());
    }

    #[test]
    fn large_gpus_trace_the_light_of_the_sky() {
        let Some(gpu) = test_gpu() else { return };
        let registry = Registry::default();
        let scene = builtin("window-room", 1).unwrap();
        let set = |device_type, purpose| {
            let adapter = AdapterSummary {
                device_type,
                ..gpu.adapter.clone()
            };
            default_set(&scene, &adapter, purpose, &registry)
        };
        let traces = |set: &DefaultSet| {
            let mut settings = set.choices.iter().flat_map(|one| &one.settings);
            settings.any(|(name, value)| (*name, value.as_str()) == (VISIBILITY, "rays"))
        };
        let [discrete, software] = [wgpu::DeviceType::DiscreteGpu, wgpu::DeviceType::Cpu];
        let still = set(discrete, Purpose::StillPicture);
        assert!(traces(&still), "{still:?}");
        let glass = builtin("ornaments", 1).unwrap();
        let adapter = AdapterSummary {
            device_type: discrete,
            ..gpu.adapter.clone()
        };
        let of_glass = default_set(&glass, &adapter, Purpose::StillPicture, &registry);
        assert!(of_glass.names().contains(&SKY.to_owned()) && !traces(&of_glass));
        assert!(!traces(&set(discrete, Purpose::LiveView)));
        assert!(!traces(&set(software, Purpose::StillPicture)));
        // It runs on any adapter.
        Renderer::with_set(&gpu, &scene, [8, 8], &still, &registry).unwrap();
        let error = LightingError::Gpu(GpuError::Pass {
            pass: RADIOSITY.into(),
            reason: "no atlas".into(),
        });
        assert!(!traces(&still.without_atlas(&error).unwrap()));
    }

    #[test]
    fn depth_maps_fit_the_atlas() {
        let of = |name| depth_maps(&builtin(name, 1).unwrap(), true);
        assert_eq!(of("cornell"), Some([2048, 512]));
        assert_eq!(of("glass-room"), Some([2048, 384]));
        let mut many = builtin("glass-room", 1).unwrap();
        let lights = many.lights.clone();
        many.lights.extend(lights.iter().cloned());
        assert_eq!(depth_maps(&many, true), Some([1024, 384]));
        for _ in 0..4 {
            many.lights.extend(lights.iter().cloned());
        }
        assert_eq!(depth_maps(&many, true), None);
    }

    #[test]
    fn rays_are_traced_in_scenes_that_bindings_hold() {
        let of = |name, triangles| gloss(&builtin(name, 1).unwrap(), triangles);
        let names =
            [MOST_TRACED, MOST_TRACED + 1].map(|triangles| of("shapes", triangles).technique);
        assert_eq!(names, [RAY_TRACING, IMPOSTORS]);
        let has_split = |name| {
            of(name, 1)
                .settings
                .iter()
                .any(|(name, _)| *name == "split")
        };
        assert_eq!(["glass-room", "shapes"].map(has_split), [true, false]);
    }

    #[test]
    fn final_gather_lights_what_takes_long_to_unwrap() {
        let Some(gpu) = test_gpu() else { return };
        let registry = Registry::default();
        let mut scene = builtin("cornell", 1).unwrap();
        // Copies share an unwrapping, but not texels.
        let triangles = scene.statistics().triangles;
        for copies in 1.. {
            let set = default_set(&scene, &gpu.adapter, Purpose::StillPicture, &registry);
            let now = scene.statistics().triangles;
            let expected = if now <= MOST_IN_TEXELS {
                RADIOSITY
            } else {
                FINAL_GATHER
            };
            assert_eq!(set.names(), ["shadow-map", expected], "{now} triangles");
            let told = if now <= MOST_IN_TEXELS {
                triangles
            } else {
                now
            };
            assert!(set.choices[1].reason.contains(&told.to_string()), "{set:?}");
            if now > MOST_IN_TEXELS {
                break;
            }
            let more = if copies == 1 {
                MOST_UNWRAPPED
            } else {
                MOST_IN_TEXELS
            };
            for _ in now / triangles..=more / triangles {
                scene.instances.extend_from_within(..8);
            }
        }
        // Meshes of their own do not.
        let mut apart = builtin("cornell", 1).unwrap();
        let fine = (0..=MOST_UNWRAPPED as u32).flat_map(|at| [at, at + 1, at + 2]);
        let mesh = apart.add_mesh(Mesh {
            positions: vec![Vec3::ZERO; MOST_UNWRAPPED as usize + 3],
            normals: vec![Vec3::Z; MOST_UNWRAPPED as usize + 3],
            indices: fine.collect(),
            ..Mesh::default()
        });
        apart.add_instance("fine", mesh, 0, Mat4::IDENTITY);
        let set = default_set(&apart, &gpu.adapter, Purpose::StillPicture, &registry);
        assert_eq!(set.names(), ["shadow-map", FINAL_GATHER]);
        assert!(set.choices[1].reason.contains("unwrapping"), "{set:?}");
        let bake = default_set(&scene, &gpu.adapter, Purpose::Bake, &registry);
        assert_eq!(bake.names(), ["shadow-map", RADIOSITY]);
        // Few triangles, but each a piece of its own.
        let mut leaves = builtin("cornell", 1).unwrap();
        let corners = 0..3 * (MOST_PIECES as u32 + 1);
        let apart = corners
            .clone()
            .map(|corner| Vec3::new(corner as f32, (corner % 3) as f32, 0.0));
        let mesh = leaves.add_mesh(Mesh {
            positions: apart.collect(),
            normals: vec![Vec3::Z; corners.len()],
            indices: corners.collect(),
            ..Mesh::default()
        });
        leaves.add_instance("leaves", mesh, 0, Mat4::IDENTITY);
        let set = default_set(&leaves, &gpu.adapter, Purpose::StillPicture, &registry);
        assert_eq!(set.names(), ["shadow-map", FINAL_GATHER]);
        // What only unwrapping tells.
        let mut set = default_set(
            &builtin("cornell", 1).unwrap(),
            &gpu.adapter,
            Purpose::StillPicture,
            &registry,
        );
        let of_pass = |pass: &str| GpuError::Pass {
            pass: pass.into(),
            reason: "too large".into(),
        };
        assert_eq!(
            set.clone().without_atlas(&of_pass("radiosity.rays").into()),
            None
        );
        set = set.without_atlas(&of_pass(RADIOSITY).into()).unwrap();
        assert_eq!(set.names(), ["shadow-map", FINAL_GATHER]);
        assert!(set.notes[0].contains("too large"));
        // Nothing to light, nothing to light it with.
        let nothing = Scene::new("nothing");
        for purpose in [Purpose::StillPicture, Purpose::LiveView, Purpose::Bake] {
            let set = default_set(&nothing, &gpu.adapter, purpose, &registry);
            assert_eq!(set, DefaultSet::default());
        }
    }
}
