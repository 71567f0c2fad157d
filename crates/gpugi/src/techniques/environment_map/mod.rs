//! Environment mapping: what ideal mirrors show of the environment, without occlusion (tutorial section 3.2.1).

use super::{Field, Info, Map, SettingError, Technique, settings};
use crate::capture::{SurfacePoints, Target, View};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::light_paths::{LightClass, LightPaths};
use crate::scene::GpuScene;
use crate::shader;

/// What environment mapping says of itself.
pub const INFO: Info = Info {
    name: "environment-map",
    summary: "the environment in ideal mirrors, without occlusion",
    source: "tutorial section 3.2.1; Blinn and Newell 1976",
    paths: &[LightPaths {
        class: LightClass::Environment,
        pattern: "LSE",
    }],
};

/// Environment mapping. Reads the environment as it is: nothing to generate.
#[derive(Debug)]
pub struct EnvironmentMap {
    gather: Kernel,
    bound: Option<(wgpu::Buffer, wgpu::Buffer, [wgpu::BindGroup; 2])>,
}

impl EnvironmentMap {
    /// Compiles the technique's pass.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene) -> Result<Self, GpuError> {
        Ok(Self {
            gather: Kernel::new(
                gpu,
                &shader!("techniques.environment_map.gather"),
                "main",
                Some(&scene.layout),
            )?,
            bound: None,
        })
    }
}

impl Technique for EnvironmentMap {
    fn info(&self) -> &'static Info {
        &INFO
    }

    fn settings(&self) -> serde_json::Value {
        serde_json::json!({})
    }

    fn fields(&self) -> &'static [Field] {
        &[]
    }

    fn set(&mut self, name: &str, value: &str) -> Result<(), SettingError> {
        settings::set(&mut serde_json::json!({}), &[], name, value)
    }

    fn generate(&mut self, _: &mut Frame<'_>, _: &GpuScene, _: &View) -> Result<(), GpuError> {
        Ok(())
    }

    fn gather(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        points: &SurfacePoints,
        target: &Target,
    ) -> Result<(), GpuError> {
        if scene.environment.is_none() {
            return Ok(());
        }
        let fresh = self.bound.as_ref().is_some_and(|(bound, radiance, _)| {
            *bound == points.points && *radiance == target.radiance
        });
        if !fresh {
            let groups = [
                self.gather.bind(
                    frame.gpu,
                    1,
                    &[
                        ("seen", points.view.as_entire_binding()),
                        ("points", points.points.as_entire_binding()),
                    ],
                )?,
                self.gather.bind(
                    frame.gpu,
                    3,
                    &[("radiance", target.radiance.as_entire_binding())],
                )?,
            ];
            self.bound = Some((points.points.clone(), target.radiance.clone(), groups));
        }
        if let Some((_, _, groups)) = &self.bound {
            frame.compute("environment-map.gather", |pass| {
                self.gather.dispatch(
                    pass,
                    &[(0, &scene.bind_group), (1, &groups[0]), (3, &groups[1])],
                    [points.count, 1, 1],
                );
            });
        }
        Ok(())
    }

    fn maps(&self) -> Vec<Map> {
        Vec::new()
    }
}
