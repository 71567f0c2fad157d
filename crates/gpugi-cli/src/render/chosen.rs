//! A renderer whose techniques were named, or chosen for its purpose.

use gpugi::default_set::DefaultSet;
use gpugi::gpu::Gpu;
use gpugi::techniques::Registry;
use gpugi::{LightingError, Purpose, Renderer, Techniques, default_set};
use gpugi_arguments::{split_settings, technique_names};
use gpugi_scene::Scene;

use super::{apply_settings, usage};

/// A renderer with the techniques that were named, or else with the default set for a purpose.
#[derive(Debug)]
pub struct Chosen {
    gpu: Gpu,
    scene: Scene,
    size: [u32; 2],
    purpose: Purpose,
    named: Vec<String>,
    settings: Vec<String>,
    /// The renderer, with all `--set` options applied.
    pub renderer: Renderer,
    /// The default set, unless techniques were named.
    pub set: Option<DefaultSet>,
    /// The one that was chosen first: what has no atlas is still in it.
    first: Option<DefaultSet>,
}

impl Chosen {
    /// For pictures of `size`; `settings` are the `--set` options.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        size: [u32; 2],
        purpose: Purpose,
        named: &[String],
        settings: &[String],
    ) -> anyhow::Result<Self> {
        let (techniques, set) = match technique_names(named) {
            Some(names) => (Techniques::Named(names), None),
            None => {
                let set = default_set(scene, &gpu.adapter, purpose, &Registry::default());
                (Techniques::from(&set), Some(set))
            }
        };
        let renderer = Renderer::new(gpu, scene, size, techniques);
        let mut renderer = renderer.map_err(usage)?;
        apply_settings(&mut renderer, settings)?;
        Ok(Self {
            gpu: gpu.clone(),
            scene: scene.clone(),
            size,
            purpose,
            named: named.to_vec(),
            settings: settings.to_vec(),
            renderer,
            first: set.clone(),
            set,
        })
    }

    /// Whether another scene, such as this one after edits, would get the same techniques and settings.
    pub fn suits(&self, scene: &Scene) -> bool {
        let registry = Registry::default();
        let choose = || default_set(scene, &self.gpu.adapter, self.purpose, &registry);
        self.first.as_ref().is_none_or(|set| *set == choose())
    }

    /// One with the same order for a scene: it has no maps yet.
    pub fn anew(&self, scene: &Scene) -> anyhow::Result<Self> {
        let (named, settings) = (&self.named, &self.settings);
        Self::new(&self.gpu, scene, self.size, self.purpose, named, settings)
    }

    /// Changes a technique's setting.
    pub fn set(&mut self, technique: &str, name: &str, value: &str) -> anyhow::Result<()> {
        self.renderer.set(technique, name, value).map_err(usage)?;
        self.settings.push(format!("{technique}.{name}={value}"));
        Ok(())
    }

    /// The light that is left out, and why the default set is not the first choice: one sentence each.
    pub fn notes(&self) -> Vec<String> {
        let left_out = self.renderer.left_out();
        let mut notes = Vec::new();
        if !left_out.is_empty() {
            notes.push(format!("not in this picture: {}", left_out.join("; ")));
        }
        notes.extend(self.set.iter().flat_map(|set| set.notes.iter().cloned()));
        notes
    }

    /// Replaces the technique of the default set that `error` says has no atlas. A note lists the `--set` options that
    /// no longer apply. Other errors are returned.
    pub fn without_atlas(&mut self, error: LightingError) -> anyhow::Result<()> {
        let registry = Registry::default();
        let set = self.set.take();
        let without_atlas = |set: DefaultSet| {
            set.without_atlas(
                &error,
                &self.scene,
                &self.gpu.adapter,
                self.purpose,
                &registry,
            )
        };
        let smaller = set.and_then(without_atlas);
        let mut set = smaller.ok_or_else(|| usage(error))?;
        let renderer = Renderer::new(&self.gpu, &self.scene, self.size, &set);
        self.renderer = renderer.map_err(usage)?;
        for [technique, key, value] in split_settings(&self.settings)? {
            if set.names().iter().any(|name| name == technique) {
                self.renderer.set(technique, key, value).map_err(usage)?;
            } else {
                let unused = format!("--set {technique}.{key}={value} has no effect");
                set.notes.push(unused);
            }
        }
        self.set = Some(set);
        Ok(())
    }
}
