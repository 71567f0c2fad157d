//! Writes any scene as a new glTF file.

use std::collections::HashMap;

use base64::Engine;
use glam::{Affine2, DMat4, Mat4, Vec2, Vec3};
use image::ExtendedColorType;
use serde_json::{Value, json};

use super::json::{Json, Object, array, object};
use super::output::Output;
use super::textures::png;
use crate::export::ExportError;
use crate::image::encode_volume;
use crate::{
    AlphaMode, Bounds, Camera, Image, Light, LightKind, Material, MaterialModel, Medium, Mesh,
    Name, Origin, PhaseFunction, Pixels, Projection, Scene, TextureRef, Wrap,
};

pub const LIGHTS: &str = "KHR_lights_punctual";
/// Cameras have no near plane here, but glTF's need one (m).
const NEAR: f32 = 0.01;

/// A scene written to a file.
pub struct Written {
    pub output: Output,
    /// The place of each scene instance in the file; `None` if the instance has no triangles.
    pub origins: Vec<Option<Origin>>,
    pub warnings: Vec<String>,
}

/// The extras of a node whose mesh stands for a sphere.
pub fn sphere_extras() -> Value {
    json!({ "gpugi": { "sphere": true } })
}

/// Writes `scene`.
pub fn write(scene: &Scene) -> Result<Written, ExportError> {
    let mut writer = Writer {
        scene,
        output: Output::new(Json::new(), &[]),
        warnings: Vec::new(),
        nodes: Vec::new(),
        geometries: HashMap::new(),
        meshes: HashMap::new(),
        everywhere: None,
    };
    writer.textures()?;
    for material in &scene.materials {
        let json = writer.material(material)?;
        writer.output.json.push("materials", json)?;
    }
    let mut origins = Vec::with_capacity(scene.instances.len());
    for instance in &scene.instances {
        if scene.meshes[instance.mesh].indices.is_empty() {
            origins.push(None);
            continue;
        }
        let mesh = writer.mesh(instance.mesh, instance.material)?;
        let node = writer.node(
            &instance.name,
            instance.world_from_mesh,
            "mesh",
            mesh.into(),
        )?;
        if instance.is_sphere {
            let json = writer.output.json.at("nodes", node)?;
            json.insert("extras".to_owned(), sphere_extras());
        }
        origins.push(Some(Origin {
            node,
            place: None,
            primitive: 0,
        }));
    }
    for camera in &scene.cameras {
        writer.camera(camera)?;
    }
    for light in &scene.lights {
        writer.light(light)?;
    }
    for medium in &scene.media {
        writer.medium(medium)?;
    }
    if scene.environment.is_some() {
        writer
            .warnings
            .push("glTF has no place for the environment, which is left out".to_owned());
    }
    if scene.rig.is_some() {
        writer
            .warnings
            .push("what moves is written as it stands".to_owned());
    }
    let json = &mut writer.output.json;
    let mut nodes = json!({ "nodes": writer.nodes });
    if let Some(extras) = writer.everywhere {
        nodes["extras"] = extras;
    }
    json.push("scenes", nodes)?;
    json.root().insert("scene".to_owned(), json!(0));
    Ok(Written {
        output: writer.output,
        origins,
        warnings: writer.warnings,
    })
}

struct Writer<'a> {
    scene: &'a Scene,
    output: Output,
    warnings: Vec<String>,
    nodes: Vec<usize>,
    /// Attributes and indices, per scene mesh.
    geometries: HashMap<usize, (Value, usize)>,
    /// glTF meshes, per scene mesh and material.
    meshes: HashMap<(usize, usize), usize>,
    /// Extras of the scene: the medium that fills everything.
    everywhere: Option<Value>,
}

impl Writer<'_> {
    fn node(
        &mut self,
        name: &Name,
        world_from_node: Mat4,
        kind: &str,
        index: Value,
    ) -> Result<usize, ExportError> {
        let mut node = json!({ "name": name.beginning() });
        let file_from_node = self.scene.file_from(world_from_node);
        if file_from_node != DMat4::IDENTITY {
            node["matrix"] = json!(file_from_node.to_cols_array());
        }
        node[kind] = index;
        let node = self.output.json.push("nodes", node)?;
        self.nodes.push(node);
        Ok(node)
    }

    fn mesh(&mut self, mesh: usize, material: usize) -> Result<usize, ExportError> {
        if let Some(&known) = self.meshes.get(&(mesh, material)) {
            return Ok(known);
        }
        let source = &self.scene.meshes[mesh];
        let (attributes, indices) = match self.geometries.get(&mesh) {
            Some(known) => known.clone(),
            None => {
                let geometry = self.geometry(source)?;
                self.geometries.insert(mesh, geometry.clone());
                geometry
            }
        };
        let primitive =
            json!({ "attributes": attributes, "indices": indices, "material": material });
        let json = json!({ "name": source.name.beginning(), "primitives": [primitive] });
        let written = self.output.json.push("meshes", json)?;
        self.meshes.insert((mesh, material), written);
        Ok(written)
    }

    fn geometry(&mut self, mesh: &Mesh) -> Result<(Value, usize), ExportError> {
        let output = &mut self.output;
        let positions: Vec<[f32; 3]> = mesh.positions.iter().map(Vec3::to_array).collect();
        let position = output.floats(&positions)?;
        let Bounds { min, max } = mesh.bounds();
        let json = output.json.at("accessors", position)?;
        json.insert("min".to_owned(), json!(min.to_array()));
        json.insert("max".to_owned(), json!(max.to_array()));
        let mut attributes = Object::new();
        let mut add = |name: &str, accessor: usize| {
            attributes.insert(name.to_owned(), accessor.into());
        };
        add("POSITION", position);
        let normals: Vec<[f32; 3]> = mesh.normals.iter().map(Vec3::to_array).collect();
        add("NORMAL", output.floats(&normals)?);
        if !mesh.tangents.is_empty() {
            let tangents: Vec<[f32; 4]> = mesh.tangents.iter().map(|t| t.to_array()).collect();
            add("TANGENT", output.floats(&tangents)?);
        }
        // glTF numbers texture coordinate sets from 0 without gaps.
        let sets = mesh.uvs.iter().rposition(|set| !set.is_empty());
        for (set, uvs) in mesh
            .uvs
            .iter()
            .enumerate()
            .take(sets.map_or(0, |set| set + 1))
        {
            let mut uvs: Vec<[f32; 2]> = uvs.iter().map(Vec2::to_array).collect();
            uvs.resize(mesh.positions.len(), [0.0; 2]);
            add(&format!("TEXCOORD_{set}"), output.floats(&uvs)?);
        }
        if !mesh.colors.is_empty() {
            let colors: Vec<[f32; 4]> = mesh.colors.iter().map(|c| c.to_array()).collect();
            add("COLOR_0", output.floats(&colors)?);
        }
        let indices = output.indices(&mesh.indices, mesh.positions.len())?;
        Ok((Value::Object(attributes), indices))
    }

    fn textures(&mut self) -> Result<(), ExportError> {
        let scene = self.scene;
        for image in &scene.images {
            let png = self.png(image)?;
            self.output.image(&image.name, &png, "image/png")?;
        }
        for texture in &scene.textures {
            let wrap = texture.wrap.map(|wrap| match wrap {
                Wrap::Repeat => 10_497,
                Wrap::MirroredRepeat => 33_648,
                Wrap::ClampToEdge => 33_071,
            });
            let filter = if texture.nearest { 9728 } else { 9729 };
            let coarser = if texture.has_levels { 9987 } else { filter };
            let sampler = json!({ "magFilter": filter, "minFilter": coarser, "wrapS": wrap[0], "wrapT": wrap[1] });
            let sampler = self.output.json.push("samplers", sampler)?;
            let texture = json!({ "sampler": sampler, "source": texture.image });
            self.output.json.push("textures", texture)?;
        }
        Ok(())
    }

    fn png(&mut self, image: &Image) -> Result<Vec<u8>, ExportError> {
        let clamped;
        let texels = match &image.pixels {
            Pixels::Rgba8(texels) => texels,
            Pixels::Rgba32Float(texels) => {
                self.warnings.push(format!(
                    "image {:?}: glTF's images have 8 bits, larger values than 1 are lost",
                    image.name
                ));
                let byte = |value: &f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
                clamped = texels.iter().map(byte).collect();
                &clamped
            }
        };
        png(image.width, image.height, texels, ExtendedColorType::Rgba8)
            .map_err(|reason| ExportError::new(format!("image {:?}", image.name), reason))
    }

    fn reference(&mut self, texture: &TextureRef) -> Result<Value, ExportError> {
        let TextureRef {
            texture,
            uv_set,
            uv_from_mesh,
        } = *texture;
        let mut json = json!({ "index": texture, "texCoord": uv_set });
        if uv_from_mesh != Affine2::IDENTITY {
            const TRANSFORM: &str = "KHR_texture_transform";
            let (scale, angle, offset) = uv_from_mesh.to_scale_angle_translation();
            let transform = json!({ "offset": offset.to_array(), "rotation": -angle, "scale": scale.to_array() });
            json["extensions"] = json!({ TRANSFORM: transform });
            self.output.json.uses(TRANSFORM)?;
        }
        Ok(json)
    }

    /// Sets `key` of `json` to a reference to the texture, if there is one.
    fn refer(
        &mut self,
        json: &mut Value,
        key: &str,
        texture: Option<&TextureRef>,
    ) -> Result<(), ExportError> {
        if let Some(texture) = texture {
            json[key] = self.reference(texture)?;
        }
        Ok(())
    }

    fn material(&mut self, material: &Material) -> Result<Value, ExportError> {
        let mut base_color = material.base_color;
        let mut metallic = material.metallic;
        let mut extras = Value::Null;
        match material.model {
            MaterialModel::MetallicRoughness => {}
            MaterialModel::Phong { kd, ks, shininess }
            | MaterialModel::Blinn { kd, ks, shininess } => {
                // The diffuse albedo is base colour times kd. Move the colour into the base colour, which other viewers
                // read, too, and leave a kd as grey as kd + ks <= 1 allows.
                let grey = Vec3::splat(kd.max_element()).min(Vec3::ONE - ks);
                let grey = grey.max(kd);
                let color = Vec3::select(grey.cmpgt(Vec3::ZERO), kd / grey, Vec3::ONE);
                base_color *= color.extend(1.0);
                let kd = grey;
                extras =
                    json!({ "kd": kd.to_array(), "ks": ks.to_array(), "shininess": shininess });
                let is_blinn = matches!(material.model, MaterialModel::Blinn { .. });
                let model = if is_blinn { "blinn" } else { "phong" };
                extras = json!({ "gpugi": { model: extras } });
            }
            MaterialModel::Conductor { n, k } => {
                // gpugi reads n and k; other viewers get the resulting reflectance at normal incidence.
                let (above, below) = (n - Vec3::ONE, n + Vec3::ONE);
                let reflectance = (above * above + k * k) / (below * below + k * k);
                base_color = reflectance
                    .clamp(Vec3::ZERO, Vec3::ONE)
                    .extend(base_color.w);
                metallic = 1.0;
                extras =
                    json!({ "gpugi": { "conductor": { "n": n.to_array(), "k": k.to_array() } } });
            }
        }
        let mut surface = json!({
            "baseColorFactor": base_color.to_array(), "metallicFactor": metallic, "roughnessFactor": material.roughness,
        });
        self.refer(
            &mut surface,
            "baseColorTexture",
            material.base_color_texture.as_ref(),
        )?;
        self.refer(
            &mut surface,
            "metallicRoughnessTexture",
            material.metallic_roughness_texture.as_ref(),
        )?;
        let mut json = json!({ "name": material.name, "pbrMetallicRoughness": surface });
        self.refer(&mut json, "normalTexture", material.normal_texture.as_ref())?;
        if material.normal_texture.is_some() {
            json["normalTexture"]["scale"] = json!(material.normal_scale);
        }
        let extensions = self.extensions(material)?;
        let largest = material.emissive.max_element();
        if largest > 0.0 {
            json["emissiveFactor"] = json!((material.emissive / largest.max(1.0)).to_array());
        }
        self.refer(
            &mut json,
            "emissiveTexture",
            material.emissive_texture.as_ref(),
        )?;
        match material.alpha_mode {
            AlphaMode::Opaque => {}
            AlphaMode::Mask { cutoff } => {
                json["alphaMode"] = json!("MASK");
                json["alphaCutoff"] = json!(cutoff);
            }
            AlphaMode::Blend => json["alphaMode"] = json!("BLEND"),
        }
        if material.double_sided {
            json["doubleSided"] = json!(true);
        }
        if !extensions.is_empty() {
            for name in extensions.keys() {
                self.output.json.uses(name)?;
            }
            json["extensions"] = Value::Object(extensions);
        }
        if !extras.is_null() {
            json["extras"] = extras;
        }
        Ok(json)
    }

    /// The extensions of the material, except those that would only repeat defaults.
    fn extensions(&mut self, material: &Material) -> Result<Object, ExportError> {
        let mut extensions = Object::new();
        let strength = material.emissive.max_element();
        if strength > 1.0 {
            let json = json!({ "emissiveStrength": strength });
            extensions.insert("KHR_materials_emissive_strength".to_owned(), json);
        }
        if material.ior != 1.5 {
            let json = json!({ "ior": material.ior });
            extensions.insert("KHR_materials_ior".to_owned(), json);
        }
        let textures = (&material.specular_texture, &material.specular_color_texture);
        let is_plain = material.specular == 1.0 && material.specular_color == Vec3::ONE;
        if !is_plain || textures != (&None, &None) {
            let mut json = json!({
                "specularFactor": material.specular, "specularColorFactor": material.specular_color.to_array(),
            });
            self.refer(&mut json, "specularTexture", textures.0.as_ref())?;
            self.refer(&mut json, "specularColorTexture", textures.1.as_ref())?;
            extensions.insert("KHR_materials_specular".to_owned(), json);
        }
        if material.transmission > 0.0 {
            let mut json = json!({ "transmissionFactor": material.transmission });
            self.refer(
                &mut json,
                "transmissionTexture",
                material.transmission_texture.as_ref(),
            )?;
            extensions.insert("KHR_materials_transmission".to_owned(), json);
        }
        if material.diffuse_transmission > 0.0 {
            let color = material.diffuse_transmission_color.to_array();
            let mut json = json!({
                "diffuseTransmissionFactor": material.diffuse_transmission, "diffuseTransmissionColorFactor": color,
            });
            self.refer(
                &mut json,
                "diffuseTransmissionTexture",
                material.diffuse_transmission_texture.as_ref(),
            )?;
            self.refer(
                &mut json,
                "diffuseTransmissionColorTexture",
                material.diffuse_transmission_color_texture.as_ref(),
            )?;
            extensions.insert("KHR_materials_diffuse_transmission".to_owned(), json);
        }
        if let Some(volume) = &material.volume {
            // Rasterizers need a thickness; ray tracers determine it themselves.
            let mut json = json!({
                "thicknessFactor": 1.0, "attenuationColor": volume.attenuation_color.to_array(),
            });
            if volume.attenuation_distance.is_finite() {
                json["attenuationDistance"] = json!(volume.attenuation_distance);
            }
            extensions.insert("KHR_materials_volume".to_owned(), json);
        }
        Ok(extensions)
    }

    fn camera(&mut self, camera: &Camera) -> Result<(), ExportError> {
        let mut json = match camera.projection {
            Projection::Perspective { vertical_fov } => json!({
                "type": "perspective", "perspective": { "yfov": vertical_fov, "znear": NEAR },
            }),
            Projection::Orthographic { height } => {
                let bounds = self.scene.bounds();
                let eye = camera.world_from_view.w_axis.truncate();
                let far = (eye - bounds.center()).length() + bounds.diagonal();
                let half = height / 2.0;
                json!({
                    "type": "orthographic",
                    "orthographic": { "xmag": half, "ymag": half, "znear": NEAR, "zfar": far.max(1.0) },
                })
            }
        };
        let mut extras = serde_json::Map::new();
        if !camera.lens.is_pinhole() {
            extras.insert("aperture".to_owned(), json!(camera.lens.aperture));
            extras.insert("focus".to_owned(), json!(camera.lens.focus));
            extras.insert("blades".to_owned(), json!(camera.lens.blades));
        }
        if camera.shutter > 0.0 {
            extras.insert("shutter".to_owned(), json!(camera.shutter));
        }
        if !extras.is_empty() {
            json["extras"] = json!({ "gpugi": extras });
        }
        let index = self.output.json.push("cameras", json)?;
        self.node(&camera.name, camera.world_from_view, "camera", index.into())?;
        Ok(())
    }

    fn medium(&mut self, medium: &Medium) -> Result<(), ExportError> {
        let (phase, g) = match medium.phase {
            PhaseFunction::HenyeyGreenstein(g) => ("henyey-greenstein", g),
            PhaseFunction::CornetteShanks(g) => ("cornette-shanks", g),
        };
        let mut json = json!({
            "extinction": medium.extinction.to_array(), "albedo": medium.albedo.to_array(),
            "phase": phase, "g": g, "emission": medium.emission.to_array(),
        });
        if let Some(density) = &medium.density {
            let file = encode_volume(density)
                .map_err(|error| ExportError::new(medium.name.as_str(), error))?;
            let data = base64::engine::general_purpose::STANDARD.encode(file);
            json["density"] = json!(format!("data:image/ktx2;base64,{data}"));
        }
        let extras = json!({ "gpugi": { "medium": json } });
        match medium.world_from_box {
            Some(place) => {
                self.node(&medium.name, place, "extras", extras)?;
            }
            None if self.everywhere.is_none() => self.everywhere = Some(extras),
            None => self.warnings.push(format!(
                "medium {:?} is left out: a file has one medium that fills everything",
                medium.name.beginning()
            )),
        }
        Ok(())
    }

    fn light(&mut self, light: &Light) -> Result<(), ExportError> {
        let intensity = light.intensity.max_element();
        let color = if intensity > 0.0 {
            light.intensity / intensity
        } else {
            Vec3::ONE
        };
        let kind = match light.kind {
            LightKind::Point => "point",
            LightKind::Spot { .. } => "spot",
            LightKind::Directional => "directional",
        };
        let mut json = json!({ "type": kind, "color": color.to_array(), "intensity": intensity });
        if let LightKind::Spot {
            inner_cone_angle,
            outer_cone_angle,
        } = light.kind
        {
            json["spot"] =
                json!({ "innerConeAngle": inner_cone_angle, "outerConeAngle": outer_cone_angle });
        }
        if let Some(range) = light.range {
            json["range"] = json!(range);
        }
        if light.radius > 0.0 {
            json["extras"] = json!({ "gpugi": { "radius": light.radius } });
        }
        let root = self.output.json.root();
        let extension = object(object(root, "extensions"), LIGHTS);
        let lights = array(extension, "lights")?;
        lights.push(json);
        let reference = json!({ LIGHTS: { "light": lights.len() - 1 } });
        self.output.json.uses(LIGHTS)?;
        let place = light.world_from_light;
        self.node(&light.name, place, "extensions", reference)?;
        Ok(())
    }
}
