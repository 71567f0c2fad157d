//! Scenes, as Python sees them: loaded, made, edited.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard};

use glam::Mat4;
use gpugi_arguments::edits;
use gpugi_arguments::scene_argument::{self, SceneArguments};
use gpugi_scene::normals::{CREASE_ANGLE, smooth_normals};
use gpugi_scene::{Environment, Mesh, Scene};
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyBytes};

use crate::camera::PyCamera;
use crate::errors::{raised, wrong};
use crate::held::{Held, List};
use crate::light::PyLight;
use crate::material::PyMaterial;
use crate::object::PyPlaced;
use crate::values::{matrix, number, numbers, rows, triangles};

/// A scene and where it comes from.
#[derive(Debug, Clone)]
pub struct Kept {
    /// Shared with what shows it, which sees by that whether it has changed since.
    pub scene: Arc<Scene>,
    /// What it was loaded with, while nothing has been edited since.
    pub source: Option<SceneArguments>,
    /// Animation time (s).
    pub time: f32,
    /// How often something was removed: what refers to an index before is then void.
    pub removals: u64,
}

impl Kept {
    pub fn new(scene: Scene, source: Option<SceneArguments>, time: f32) -> Self {
        Self {
            scene: Arc::new(scene),
            source,
            time,
            removals: 0,
        }
    }

    /// Changes the scene.
    pub fn change<R>(&mut self, change: impl FnOnce(&mut Scene) -> R) -> R {
        self.source = None;
        change(Arc::make_mut(&mut self.scene))
    }
}

/// A scene that Python holds, with all that refers to it.
pub type Shared = Arc<Mutex<Kept>>;

/// Nobody panics while it is locked, and if, the scene is as whole as before.
pub fn lock(shared: &Shared) -> MutexGuard<'_, Kept> {
    shared.lock().unwrap_or_else(|broken| broken.into_inner())
}

/// Everything that is lit, and its lights and cameras; world space is right-handed, +Y up, in metres.
#[pyclass(name = "Scene", module = "gpugi", frozen)]
pub struct PyScene {
    pub shared: Shared,
    notes: Vec<String>,
}

impl PyScene {
    pub fn new(scene: Scene, source: Option<SceneArguments>, notes: Vec<String>) -> Self {
        let time = source.as_ref().map_or(0.0, |source| source.time);
        // What the file does not have is not found in it again.
        let is_of_file = |source: &SceneArguments| {
            source.edit.is_empty() && source.without.is_empty() && source.time == 0.0
        };
        let source = source.filter(is_of_file).and_then(|source| {
            let path = std::path::absolute(&source.scene)
                .ok()?
                .to_str()?
                .to_owned();
            let is_file = std::path::Path::new(&path).is_file();
            let folder = source
                .files_from
                .map(std::path::absolute)
                .transpose()
                .ok()?;
            is_file.then_some(SceneArguments {
                scene: path,
                files_from: folder,
                ..source
            })
        });
        Self::of_state(Kept::new(scene, source, time), notes)
    }

    pub fn of_state(kept: Kept, notes: Vec<String>) -> Self {
        Self {
            shared: Arc::new(Mutex::new(kept)),
            notes,
        }
    }

    /// Loads what the arguments name, without Python's lock.
    fn of(py: Python<'_>, arguments: SceneArguments) -> PyResult<Self> {
        let loaded = py.detach(|| scene_argument::load(&arguments));
        let (scene, notes) = loaded.map_err(raised)?;
        Ok(Self::new(scene, Some(arguments), notes))
    }

    /// Changes the scene.
    fn change<R>(&self, change: impl FnOnce(&mut Scene) -> R) -> R {
        lock(&self.shared).change(change)
    }
}

/// The scene that an argument means: a `Scene`, or what `Scene.load` takes.
pub fn scene_of(argument: &Bound<'_, PyAny>) -> PyResult<Shared> {
    if let Ok(scene) = argument.cast::<PyScene>() {
        return Ok(scene.get().shared.clone());
    }
    let name = name_of(argument)?;
    let scene = PyScene::of(argument.py(), SceneArguments::of(&name))?;
    Ok(scene.shared)
}

/// A path or a name as text.
fn name_of(argument: &Bound<'_, PyAny>) -> PyResult<String> {
    let path: PathBuf = argument.extract().map_err(|_| {
        wrong(
            "scene",
            "a Scene, a file, or the name of a built-in scene is needed",
        )
    })?;
    (path.into_os_string().into_string()).map_err(|name| wrong("scene", format!("{name:?}")))
}

#[pymethods]
impl PyScene {
    /// An empty scene.
    #[new]
    #[pyo3(signature = (name = "scene"))]
    fn empty(name: &str) -> Self {
        Self::new(Scene::new(name), None, Vec::new())
    }

    /// Loads a file (.gltf, .glb, .obj, .ply), or a built-in scene by its name.
    ///
    /// As the command, it adds a sky to a scene without light; `notes` says so.
    #[staticmethod]
    #[pyo3(signature = (scene, *, environment = None, detail = 1, time = 0.0, without = "", edit = Vec::new(), files_from = None, limits = ""))]
    #[allow(clippy::too_many_arguments)]
    fn load(
        py: Python<'_>,
        scene: &Bound<'_, PyAny>,
        environment: Option<PathBuf>,
        detail: u32,
        time: f32,
        without: &str,
        edit: Vec<String>,
        files_from: Option<PathBuf>,
        limits: &str,
    ) -> PyResult<Self> {
        if !(1..=64).contains(&detail) {
            return Err(wrong(
                "detail",
                format!("{detail} does not lie between 1 and 64"),
            ));
        }
        let arguments = SceneArguments {
            scene: name_of(scene)?,
            detail,
            environment,
            time,
            without: without.to_owned(),
            edit,
            files_from,
            limits: limits.to_owned(),
        };
        Self::of(py, arguments)
    }

    /// The name of the file, or of the built-in scene.
    #[getter]
    fn name(&self) -> String {
        lock(&self.shared).scene.name.clone()
    }

    /// What loading had to say, one sentence each.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    /// Counts and sizes, as `gpugi info` prints them.
    #[getter]
    fn statistics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let statistics = lock(&self.shared).scene.statistics();
        crate::json::object(py, &serde_json::to_value(statistics).unwrap_or_default())
    }

    /// Where the origin of world space lies in the file's coordinates (m): not at 0 for scenes far away.
    #[getter]
    fn origin(&self) -> [f64; 3] {
        lock(&self.shared).scene.origin.to_array()
    }

    /// The corners of the box that holds all objects (m), in the file's coordinates: two tuples of three.
    #[getter]
    fn bounds(&self) -> ([f64; 3], [f64; 3]) {
        let statistics = lock(&self.shared).scene.statistics();
        (statistics.bounds_min, statistics.bounds_max)
    }

    /// Points, spots and directions.
    #[getter]
    fn lights(&self) -> List {
        List::new(self.shared.clone(), crate::held::Kind::Lights)
    }

    /// What surfaces are made of.
    #[getter]
    fn materials(&self) -> List {
        List::new(self.shared.clone(), crate::held::Kind::Materials)
    }

    /// Placed meshes.
    #[getter]
    fn objects(&self) -> List {
        List::new(self.shared.clone(), crate::held::Kind::Objects)
    }

    /// Cameras, the default one first.
    #[getter]
    fn cameras(&self) -> List {
        List::new(self.shared.clone(), crate::held::Kind::Cameras)
    }

    /// The camera of an index or a name; without, the first, or one that frames the scene for an image of this aspect
    /// ratio (width / height). Also takes the words of the command: "eye=0,1,3;target=0,0,0;fov=40".
    #[pyo3(signature = (which = None, *, aspect = 1.0))]
    fn camera(&self, which: Option<&Bound<'_, PyAny>>, aspect: f32) -> PyResult<PyCamera> {
        let words = match which {
            Some(which) => Some(which.str()?.to_string()),
            None => None,
        };
        let camera = {
            let kept = lock(&self.shared);
            scene_argument::camera(&kept.scene, words.as_deref(), aspect)
        };
        Ok(PyCamera(Held::own(camera.map_err(raised)?)))
    }

    /// Adds a mesh and places it. Triangles are counter-clockwise where they face the viewer.
    ///
    /// vertices: (N, 3) numbers (m); triangles: (M, 3) indices; normals: (N, 3), smooth ones without; uvs: (N, 2), v
    /// downward; transform: a 4x4 matrix, world space from the mesh's.
    #[pyo3(signature = (vertices, triangles, *, material = None, transform = None, normals = None, uvs = None, name = ""))]
    #[allow(clippy::too_many_arguments)]
    fn add_mesh(
        &self,
        vertices: &Bound<'_, PyAny>,
        triangles: &Bound<'_, PyAny>,
        material: Option<&Bound<'_, PyMaterial>>,
        transform: Option<&Bound<'_, PyAny>>,
        normals: Option<&Bound<'_, PyAny>>,
        uvs: Option<&Bound<'_, PyAny>>,
        name: &str,
    ) -> PyResult<PyPlaced> {
        let mesh = mesh_of(name, vertices, triangles, normals, uvs)?;
        let place = transform.map_or(Ok(Mat4::IDENTITY), |value| matrix("transform", value))?;
        let material = match material {
            Some(material) => material.get().0.get()?,
            None => gpugi_scene::Material::default(),
        };
        let index = self.change(|scene| {
            let material = scene.add_material(material);
            let mesh = scene.add_mesh(mesh);
            scene.add_instance(name, mesh, material, place)
        });
        Ok(PyPlaced(Held::of(self.shared.clone(), index)))
    }

    /// Adds a light.
    fn add_light(&self, light: &Bound<'_, PyLight>) -> PyResult<PyLight> {
        let light = light.get().0.get()?;
        let index = self.change(|scene| {
            scene.lights.push(light);
            scene.lights.len() - 1
        });
        Ok(PyLight(Held::of(self.shared.clone(), index)))
    }

    /// Adds a camera.
    fn add_camera(&self, camera: &Bound<'_, PyCamera>) -> PyResult<PyCamera> {
        let camera = camera.get().0.get()?;
        let index = self.change(|scene| {
            scene.cameras.push(camera);
            scene.cameras.len() - 1
        });
        Ok(PyCamera(Held::of(self.shared.clone(), index)))
    }

    /// Removes the objects, lights and media of these names; * stands for any characters.
    fn remove(&self, names: &str) -> PyResult<()> {
        let removed = {
            let mut kept = lock(&self.shared);
            let removed = kept.change(|scene| scene.remove(names));
            kept.removals += 1;
            removed
        };
        removed.map_err(|error| wrong("names", error))
    }

    /// Edits as the command does: "light.0.position=0,2,0".
    fn edit(&self, edit: &str) -> PyResult<()> {
        let edited = self.change(|scene| edits::apply(&[edit.to_owned()], scene));
        edited.map_err(raised)
    }

    /// Sets what moves by animation to a time (s).
    fn pose(&self, time: &Bound<'_, PyAny>) -> PyResult<()> {
        let time = number("time", time)?;
        self.change(|scene| scene.pose(time));
        lock(&self.shared).time = time;
        Ok(())
    }

    /// Lights the scene by an equirectangular image (.hdr, .exr, .ktx2, .png, .jpg), or by an array of shape (height,
    /// width, 3) with linear radiance; `None` switches the environment off. rotation: degrees about +Y, or yaw, pitch and
    /// roll.
    #[pyo3(signature = (image, *, rotation = None, intensity = None))]
    fn set_environment(
        &self,
        py: Python<'_>,
        image: Option<&Bound<'_, PyAny>>,
        rotation: Option<&Bound<'_, PyAny>>,
        intensity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let mut environment = match image {
            None => None,
            Some(image) => Some(environment_of(py, image)?),
        };
        if let Some(environment) = &mut environment {
            if let Some(value) = rotation {
                let degrees = match value.extract::<f64>() {
                    Ok(_) => [number("rotation", value)?, 0.0, 0.0],
                    Err(_) => numbers("rotation", value)?,
                };
                environment.rotation = Environment::rotation_by(degrees.map(f32::to_radians));
            }
            if let Some(value) = intensity {
                let [zero, most] = [0.0, f32::MAX];
                environment.intensity = crate::values::number_in("intensity", value, [zero, most])?;
            }
        }
        self.change(|scene| scene.environment = environment);
        Ok(())
    }

    /// A copy, which shares meshes and images until one of both changes.
    fn copy(&self) -> Self {
        Self {
            shared: Arc::new(Mutex::new(lock(&self.shared).clone())),
            notes: self.notes.clone(),
        }
    }

    fn __repr__(&self) -> String {
        let kept = lock(&self.shared);
        let statistics = kept.scene.statistics();
        format!(
            "Scene({:?}, {} objects, {} triangles, {} lights)",
            kept.scene.name,
            statistics.instances,
            statistics.triangles,
            kept.scene.lights.len()
        )
    }

    /// Pickles hold all of the scene.
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let kept = lock(&self.shared).clone();
        let bytes = py.detach(|| crate::pickle::bytes(&kept, &self.notes))?;
        let read = py.import("gpugi._gpugi")?.getattr("scene_from_bytes")?;
        Ok((read, (PyBytes::new(py, &bytes),)))
    }
}

fn mesh_of(
    name: &str,
    vertices: &Bound<'_, PyAny>,
    indices: &Bound<'_, PyAny>,
    normals: Option<&Bound<'_, PyAny>>,
    uvs: Option<&Bound<'_, PyAny>>,
) -> PyResult<Mesh> {
    let positions: Vec<[f32; 3]> = rows("vertices", vertices)?;
    let indices = triangles("triangles", indices)?;
    let count = positions.len();
    if let Some(index) = indices
        .iter()
        .flatten()
        .find(|index| **index as usize >= count)
    {
        let reason = format!("there is no vertex {index} among {count}");
        return Err(wrong("triangles", reason));
    }
    let as_many = |name: &str, found: usize| match found == count {
        true => Ok(()),
        false => Err(wrong(name, format!("{found} rows for {count} vertices"))),
    };
    let mut mesh = Mesh {
        name: name.into(),
        positions: positions.into_iter().map(Into::into).collect(),
        indices: indices.into_iter().flatten().collect(),
        ..Mesh::default()
    };
    if let Some(uvs) = uvs {
        let uvs: Vec<[f32; 2]> = rows("uvs", uvs)?;
        as_many("uvs", uvs.len())?;
        mesh.uvs[0] = uvs.into_iter().map(Into::into).collect();
    }
    match normals {
        Some(normals) => {
            let normals: Vec<[f32; 3]> = rows("normals", normals)?;
            as_many("normals", normals.len())?;
            let unit = |normal: [f32; 3]| glam::Vec3::from(normal).try_normalize();
            let unit: Option<Vec<_>> = normals.into_iter().map(unit).collect();
            mesh.normals = unit.ok_or_else(|| wrong("normals", "one has no direction"))?;
        }
        None => smooth_normals(&mut mesh, CREASE_ANGLE),
    }
    mesh.check().map_err(|reason| wrong("vertices", reason))?;
    Ok(mesh)
}

fn environment_of(py: Python<'_>, image: &Bound<'_, PyAny>) -> PyResult<Environment> {
    if let Ok(path) = image.extract::<PathBuf>() {
        let limits = gpugi_scene::Limits::default();
        let loaded = py.detach(|| gpugi_scene::import_environment(&path, &limits));
        return loaded.map_err(raised);
    }
    let ([width, height], radiance) = crate::values::pixels("image", image)?;
    if radiance
        .iter()
        .any(|value| !value.is_finite() || *value < 0.0)
    {
        return Err(wrong("image", "radiance is finite and not negative"));
    }
    let rgba = radiance
        .as_chunks::<3>()
        .0
        .iter()
        .flat_map(|[r, g, b]| [*r, *g, *b, 1.0]);
    let image = gpugi_scene::Image {
        name: "environment".into(),
        width,
        height,
        pixels: gpugi_scene::Pixels::Rgba32Float(rgba.collect()),
    };
    Ok(Environment {
        image: Arc::new(image),
        rotation: glam::Quat::IDENTITY,
        intensity: 1.0,
    })
}
