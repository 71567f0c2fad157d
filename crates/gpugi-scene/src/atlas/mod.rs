//! Texture atlases: they assign every triangle of every instance its own place in texels, so that light can be stored
//! there.
//!
//! Charts are unwrapped by uvunwrap: segmentation into nearly flat charts, least squares conformal maps made as rigid
//! as possible, and packing by shape. It is pure Rust and therefore works in a browser, gives the same atlas for any
//! number of threads, and mirrors nothing. docs/atlas.md compares it with xatlas. If a file provides a valid second set
//! of texture coordinates ([`check_second_set`]), its charts are kept and only repacked, so that gutters and texel
//! density are as requested, whatever resolution the file's author had in mind.

mod error;
mod options;
mod seams;
mod second_set;
mod shape;
mod uvs;

pub use error::AtlasError;
pub use options::{AtlasOptions, TexelDensity};
pub use seams::Seams;
pub use second_set::{SecondSetFault, check_second_set};
pub use uvs::{Atlas, InstanceUvs, LARGEST_PAGE, NO_CHART, Side};

use std::collections::HashMap;

use glam::Vec2;
use uvunwrap::{Density, MeshInput, OutputMesh, OutputVertex, Packing};

use crate::Scene;
use shape::Shape;

/// With more triangles than this, charts are packed by outline: three times as fast as by shape, for about a tenth more
/// texels.
const MOST_PACKED_BY_SHAPE: usize = 20_000;

impl Atlas {
    /// Lays out every instance of a scene in its current state. The same scene and options give the same atlas.
    ///
    /// Instances share an unwrapping if they share a mesh and are stretched alike, but each has its own rectangle.
    /// Instances without area, and those of nothing but slivers, are left out.
    ///
    /// # Errors
    /// [`AtlasError`]: options out of range, invalid meshes or transforms, or more texels than the options allow.
    pub fn new(scene: &Scene, options: &AtlasOptions) -> Result<Self, AtlasError> {
        Self::with_progress(scene, options, |_| true)
    }

    /// Like [`Atlas::new`], but from time to time calls `goes_on` with the fraction of work done so far (0 to 1);
    /// returning `false` cancels. It may be called from any thread, but never concurrently.
    ///
    /// # Errors
    /// Those of [`Atlas::new`], and [`AtlasError::Cancelled`].
    pub fn with_progress(
        scene: &Scene,
        options: &AtlasOptions,
        goes_on: impl Fn(f32) -> bool + Sync,
    ) -> Result<Self, AtlasError> {
        check_options(options)?;
        let (shapes, [fronts, backs]) = shapes(scene, options)?;
        check_area(&shapes, options)?;
        if shapes.is_empty() {
            return Ok(Self {
                size: options.size,
                pages: 0,
                instances: vec![None; scene.instances.len()],
                backs: Vec::new(),
            });
        }
        let second_sets: Vec<Option<&[[f32; 2]]>> = shapes
            .iter()
            .map(|shape| {
                let mesh = &scene.meshes[shape.mesh];
                let is_valid = options.use_second_set && check_second_set(mesh).is_ok();
                is_valid.then(|| bytemuck::cast_slice(&mesh.uvs[1][..]))
            })
            .collect();
        let inputs: Vec<MeshInput<'_>> = shapes
            .iter()
            .zip(&second_sets)
            .map(|(shape, &existing_uvs)| MeshInput {
                instance_scales: &shape.scales,
                existing_uvs,
                ..MeshInput::new(&shape.positions, &scene.meshes[shape.mesh].indices)
            })
            .collect();
        let triangles: usize = inputs.iter().map(|input| input.indices.len() / 3).sum();
        let unwrapped = uvunwrap::generate_with_progress(
            &inputs,
            &uvunwrap::Options {
                density: match options.density {
                    TexelDensity::OnePage => Density::Auto {
                        page_size: options.size,
                    },
                    TexelDensity::PerMetre(texels_per_unit) => Density::Fixed {
                        texels_per_unit,
                        page_size: Some(options.size),
                    },
                },
                padding: options.gutter,
                packing: if triangles > MOST_PACKED_BY_SHAPE {
                    Packing::Fast
                } else {
                    Packing::Shape
                },
                ..Default::default()
            },
            |progress| goes_on(share_done(progress)),
        )
        .map_err(|error| AtlasError::of_unwrapper(error, options))?;
        if unwrapped.page_count > options.most_pages {
            return Err(AtlasError::TooManyPages {
                needed: u64::from(unwrapped.page_count),
                limit: options.most_pages,
                size: options.size,
                at_any_density: options.density == TexelDensity::OnePage,
            });
        }
        // If everything fits one page, the unwrapper crops that page to its used part.
        let page = Vec2::new(unwrapped.width as f32, unwrapped.height as f32);
        let scale = page / options.size as f32;
        let place = |place: &Option<(usize, usize)>| {
            let &(shape, number) = place.as_ref()?;
            placed(&unwrapped.meshes[shape], number, scale)
        };
        Ok(Self {
            size: options.size,
            pages: unwrapped.page_count,
            instances: fronts.iter().map(place).collect(),
            backs: backs.iter().map(place).collect(),
        })
    }

    /// Triangles of the scene, in all instances, that are too thin for texels of their own: those without a chart, and
    /// those of instances that are not in the atlas.
    pub fn slivers(&self, scene: &Scene) -> usize {
        let places = self.instances.iter().zip(&scene.instances);
        let slivers = places.map(|(uvs, instance)| match uvs {
            Some(uvs) => uvs
                .charts
                .iter()
                .filter(|&&chart| chart == NO_CHART)
                .count(),
            None => scene.meshes[instance.mesh].indices.len() / 3,
        });
        slivers.sum()
    }

    /// Checks that the atlas belongs to this scene.
    ///
    /// # Errors
    /// Why it does not.
    pub fn check(&self, scene: &Scene) -> Result<(), String> {
        if self.instances.len() != scene.instances.len() {
            return Err(format!(
                "the atlas has {} instances, the scene {}",
                self.instances.len(),
                scene.instances.len()
            ));
        }
        if !(1..=LARGEST_PAGE).contains(&self.size) {
            return Err(format!("pages of {} texels a side", self.size));
        }
        if self.backs.len() > scene.instances.len() {
            return Err(format!(
                "the atlas has the backs of {} instances, the scene {}",
                self.backs.len(),
                scene.instances.len()
            ));
        }
        for (number, _, uvs) in self.sides() {
            let instance = &scene.instances[number];
            let indices = scene.meshes[instance.mesh].indices.len();
            if uvs.corners.len() != indices || uvs.charts.len() * 3 != indices {
                return Err(format!(
                    "instance {number} has {} corners and {} charts for {indices} indices",
                    uvs.corners.len(),
                    uvs.charts.len()
                ));
            }
            if uvs.page >= self.pages {
                return Err(format!(
                    "instance {number} lies in page {} of {}",
                    uvs.page, self.pages
                ));
            }
            let is_inside = |uv: &Vec2| uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all();
            if let Some(corner) = uvs.corners.iter().position(|uv| !is_inside(uv)) {
                let uv = uvs.corners[corner];
                return Err(format!(
                    "corner {corner} of instance {number} lies at {uv}, not in 0 to 1"
                ));
            }
        }
        Ok(())
    }
}

fn check_options(options: &AtlasOptions) -> Result<(), AtlasError> {
    let refuse = |option, value: f64, least: f64, most: f64| {
        Err(AtlasError::Option {
            option,
            value,
            least,
            most,
        })
    };
    if !(16..=LARGEST_PAGE).contains(&options.size) {
        let value = f64::from(options.size);
        return refuse("size", value, 16.0, f64::from(LARGEST_PAGE));
    }
    let widest = options.size / 8;
    if options.gutter > widest {
        let value = f64::from(options.gutter);
        return refuse("gutter", value, 0.0, f64::from(widest));
    }
    if let TexelDensity::PerMetre(density) = options.density {
        let (least, most) = (1e-6, 1e6);
        if !(least..=most).contains(&density) {
            let [value, least, most] = [density, least, most].map(f64::from);
            return refuse("density", value, least, most);
        }
    }
    Ok(())
}

/// What is unwrapped, each shape once; and for the front and the back of each instance, its shape and its number among
/// all that have that shape.
type Shapes = (Vec<Shape>, [Vec<Option<(usize, usize)>>; 2]);

fn shapes(scene: &Scene, options: &AtlasOptions) -> Result<Shapes, AtlasError> {
    // The ground of a landscape must not take the texels of what stands on it: it gets as many as a ground twice as
    // large as the core.
    let largest = match options.density {
        TexelDensity::OnePage => 2.0 * scene.core().diagonal(),
        TexelDensity::PerMetre(_) => f32::INFINITY,
    };
    let mut shapes: Vec<Shape> = Vec::new();
    let mut numbers = HashMap::new();
    let mut checked = vec![false; scene.meshes.len()];
    let mut is_open = vec![None; scene.meshes.len()];
    let [mut fronts, mut backs] = [const { Vec::new() }; 2];
    for (index, instance) in scene.instances.iter().enumerate() {
        let mesh = &scene.meshes[instance.mesh];
        if !checked[instance.mesh] {
            mesh.check().map_err(|reason| AtlasError::Mesh {
                mesh: instance.mesh,
                name: mesh.name.to_string(),
                reason,
            })?;
            checked[instance.mesh] = true;
        }
        let refused = |reason| AtlasError::Instance {
            instance: index,
            name: instance.name.to_string(),
            reason,
        };
        let bounds = mesh.bounds().transformed(&instance.world_from_mesh);
        let density = (largest / bounds.diagonal()).min(1.0);
        let Some((key, shape)) = Shape::new(instance, mesh, density).map_err(refused)? else {
            fronts.push(None);
            backs.push(None);
            continue;
        };
        let material = &scene.materials[instance.material];
        let has_back = options.backs
            && material.has_two_sides()
            && (material.is_translucent()
                || *is_open[instance.mesh].get_or_insert_with(|| !mesh.is_closed()));
        let number = *numbers.entry(key).or_insert(shapes.len());
        let (area, scale) = (shape.area, shape.scales[0]);
        if number == shapes.len() {
            shapes.push(shape.with_positions(mesh));
        }
        let known = &mut shapes[number];
        let mut add = || {
            known.area += area;
            known.scales.push(scale);
            Some((number, known.scales.len() - 1))
        };
        fronts.push(add());
        backs.push(has_back.then(&mut add).flatten());
    }
    Ok((shapes, [fronts, backs]))
}

/// Rejects what cannot fit before any work is done.
fn check_area(shapes: &[Shape], options: &AtlasOptions) -> Result<(), AtlasError> {
    let TexelDensity::PerMetre(density) = options.density else {
        return Ok(());
    };
    let area: f64 = shapes.iter().map(|shape| shape.area).sum();
    let page = f64::from(options.size).powi(2);
    let needed = (area * f64::from(density).powi(2) / page).ceil();
    if needed > f64::from(options.most_pages) {
        return Err(AtlasError::TooManyPages {
            needed: needed as u64,
            limit: options.most_pages,
            size: options.size,
            at_any_density: false,
        });
    }
    Ok(())
}

/// The four stages take about 0.1, 0.6, 0.2 and 0.1 of the time. The number of packing attempts is not known in
/// advance.
fn share_done(progress: uvunwrap::Progress) -> f32 {
    let done = progress.total.map_or(0.5, |total| {
        (progress.done as f32 / total.max(1) as f32).min(1.0)
    });
    match progress.stage {
        uvunwrap::Stage::Segmenting => 0.1 * done,
        uvunwrap::Stage::Parameterizing => 0.1 + 0.6 * done,
        uvunwrap::Stage::Packing => 0.7 + 0.2 * done,
        _ => 0.9 + 0.1 * done,
    }
}

/// The `number`th instance of an unwrapped mesh; `None` if the unwrapper found no triangle with an area.
fn placed(mesh: &OutputMesh, number: usize, scale: Vec2) -> Option<InstanceUvs> {
    let rectangle = mesh.instances.get(number)?;
    let vertex = |&index: &u32| -> &OutputVertex { &mesh.vertices[index as usize] };
    // Charts are numbered consecutively over all meshes, in mesh order.
    let first_chart = mesh
        .vertices
        .iter()
        .filter_map(|vertex| vertex.chart)
        .min()?;
    let (min, max) = (Vec2::from(rectangle.min), Vec2::from(rectangle.max));
    let place =
        |uv: [f32; 2]| ((min + Vec2::from(uv) * (max - min)) * scale).clamp(Vec2::ZERO, Vec2::ONE);
    let corners: Vec<Vec2> = mesh
        .indices
        .iter()
        .map(|index| place(vertex(index).uv))
        .collect();
    let charts = mesh
        .indices
        .as_chunks::<3>()
        .0
        .iter()
        .map(|triangle| {
            let [a, b, c] = triangle.each_ref().map(|index| vertex(index).uv);
            let [a, b, c] = [a, b, c].map(Vec2::from);
            match vertex(&triangle[0]).chart {
                Some(chart) if (b - a).perp_dot(c - a) != 0.0 => chart - first_chart,
                _ => NO_CHART,
            }
        })
        .collect();
    Some(InstanceUvs {
        page: rectangle.page,
        corners,
        charts,
    })
}
