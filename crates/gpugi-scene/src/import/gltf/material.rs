//! Materials: metallic-roughness with its extensions, and specular-glossiness converted to it.

use glam::{Vec3, Vec4};

use super::document::Document;
use super::texture::Textures;
use super::{extras, schema};
use crate::import::quoted;
use crate::{AlphaMode, ImportError, Material, MaterialModel, Resolver, Scene, Volume};

/// Maps primitives to scene materials.
#[derive(Default)]
pub struct Materials {
    default: Option<usize>,
    /// Per material of the file.
    uv_sets: Vec<[u32; 2]>,
}

impl Materials {
    /// The scene material for glTF's `index`; without an index, glTF's default material.
    pub fn index(
        &mut self,
        document: &Document,
        index: Option<usize>,
        place: &str,
        scene: &mut Scene,
    ) -> Result<usize, ImportError> {
        match index {
            Some(index) => {
                document.get(&document.root.materials, "material", index, place)?;
                Ok(index)
            }
            None => Ok(*self.default.get_or_insert_with(|| {
                scene.add_material(Material {
                    name: "default".to_owned(),
                    metallic: 1.0,
                    ..Material::default()
                })
            })),
        }
    }

    /// The UV sets of the file that fill the slots of [`crate::Mesh::uvs`] for the textures of a scene material.
    pub fn uv_sets(&self, material: usize) -> [u32; 2] {
        self.uv_sets.get(material).copied().unwrap_or([0, 1])
    }
}

/// Adds all materials of the file to `scene`, in file order, with the images that they use.
pub fn read_all(
    document: &Document,
    resolver: &dyn Resolver,
    scene: &mut Scene,
) -> Result<Materials, ImportError> {
    let mut textures = Textures::new(document, resolver);
    let mut uv_sets = Vec::with_capacity(document.root.materials.len());
    for (index, source) in document.root.materials.iter().enumerate() {
        let reader = Reader {
            document,
            source,
            place: format!("materials[{index}]"),
        };
        textures.uv_sets = reader.uv_sets();
        uv_sets.push(textures.uv_sets);
        let material = reader.read(index, &mut textures, scene)?;
        scene.add_material(material);
    }
    Ok(Materials {
        uv_sets,
        ..Materials::default()
    })
}

struct Reader<'a> {
    document: &'a Document<'a>,
    source: &'a schema::Material,
    place: String,
}

impl Reader<'_> {
    fn read(
        &self,
        index: usize,
        textures: &mut Textures,
        scene: &mut Scene,
    ) -> Result<Material, ImportError> {
        let Self {
            document,
            source,
            place,
        } = self;
        let mut material = Material {
            name: source
                .name
                .clone()
                .unwrap_or_else(|| format!("material {index}")),
            model: extras::material_model(document, &source.extras, place)?,
            alpha_mode: self.alpha_mode()?,
            double_sided: source.double_sided,
            ..Material::default()
        };
        if source.extensions.unlit.is_some() {
            self.metallic_roughness(&mut material, textures, scene)?;
            show_unlit(&mut material);
            return Ok(material);
        }
        match &source.extensions.specular_glossiness {
            Some(model) => self.specular_glossiness(model, &mut material, textures, scene)?,
            None => {
                self.metallic_roughness(&mut material, textures, scene)?;
                self.dielectric(&mut material, textures, scene)?;
            }
        }
        if let Some(info) = &source.normal_texture {
            material.normal_texture =
                textures.read(Some(info), &format!("{place}.normalTexture"), scene);
            material.normal_scale = info.scale;
        }
        let strength = source
            .extensions
            .emissive_strength
            .as_ref()
            .map_or(1.0, |extension| extension.emissive_strength);
        material.emissive = Vec3::from(source.emissive_factor) * strength;
        if !material.emissive.is_finite() || material.emissive.cmplt(Vec3::ZERO).any() {
            return Err(document.error(
                format!("{place}.emissiveFactor"),
                format!("{} is no radiance", material.emissive),
            ));
        }
        material.emissive_texture = textures.read(
            source.emissive_texture.as_ref(),
            &format!("{place}.emissiveTexture"),
            scene,
        );
        if source.emissive_texture.is_some() && material.emissive_texture.is_none() {
            // The texture says where it glows; without it, all of it would.
            material.emissive = Vec3::ZERO;
        }
        Ok(material)
    }

    /// The UV sets that fill the two slots. Sets 0 and 1 keep their slots if textures use them; another set takes a
    /// free slot. If the textures use more than two sets, the least important textures are left out.
    fn uv_sets(&self) -> [u32; 2] {
        let extensions = &self.source.extensions;
        let surface = &self.source.pbr_metallic_roughness;
        let others = [&self.source.normal_texture, &self.source.emissive_texture];
        let mut textures = vec![&surface.base_color_texture];
        match &extensions.specular_glossiness {
            _ if extensions.unlit.is_some() => {}
            Some(model) => {
                textures[0] = &model.diffuse_texture;
                textures.extend(others);
                textures.push(&model.specular_glossiness_texture);
            }
            None => {
                textures.extend(others);
                textures.push(&surface.metallic_roughness_texture);
                if let Some(specular) = &extensions.specular {
                    textures.extend([&specular.specular_color_texture, &specular.specular_texture]);
                }
                let transmission = extensions.transmission.as_ref();
                textures
                    .extend(transmission.map(|transmission| &transmission.transmission_texture));
                if let Some(transmission) = &extensions.diffuse_transmission {
                    textures.extend([
                        &transmission.diffuse_transmission_color_texture,
                        &transmission.diffuse_transmission_texture,
                    ]);
                }
            }
        }
        let mut named: Vec<u32> = Vec::new();
        for set in textures
            .into_iter()
            .flatten()
            .map(schema::TextureInfo::uv_set)
        {
            if named.len() < 2 && !named.contains(&set) {
                named.push(set);
            }
        }
        let mut slots = [0, 1].map(|set| named.contains(&set).then_some(set));
        for set in named.into_iter().filter(|set| *set > 1) {
            if let Some(free) = slots.iter_mut().find(|slot| slot.is_none()) {
                *free = Some(set);
            }
        }
        [slots[0].unwrap_or(0), slots[1].unwrap_or(1)]
    }

    fn metallic_roughness(
        &self,
        material: &mut Material,
        textures: &mut Textures,
        scene: &mut Scene,
    ) -> Result<(), ImportError> {
        let source = &self.source.pbr_metallic_roughness;
        let place = format!("{}.pbrMetallicRoughness", self.place);
        material.base_color = self.color("baseColorFactor", source.base_color_factor);
        material.base_color_texture = textures.read(
            source.base_color_texture.as_ref(),
            &format!("{place}.baseColorTexture"),
            scene,
        );
        material.metallic = self.fraction("metallicFactor", source.metallic_factor);
        material.roughness = self.fraction("roughnessFactor", source.roughness_factor);
        material.metallic_roughness_texture = textures.read(
            source.metallic_roughness_texture.as_ref(),
            &format!("{place}.metallicRoughnessTexture"),
            scene,
        );
        if source.metallic_roughness_texture.is_some()
            && material.metallic_roughness_texture.is_none()
        {
            // The texture says what is metal; the factor is 1 then, also where nothing is.
            material.metallic = 0.0;
        }
        Ok(())
    }

    /// KHR_materials_ior, _specular, _transmission, _diffuse_transmission and _volume.
    fn dielectric(
        &self,
        material: &mut Material,
        textures: &mut Textures,
        scene: &mut Scene,
    ) -> Result<(), ImportError> {
        let extensions = &self.source.extensions;
        let place = |extension: &str| format!("{}.extensions.{extension}", self.place);
        if let Some(extension) = &extensions.ior {
            material.ior = extension.ior;
            if material.ior != 0.0 && material.ior < 1.0 {
                return Err(self.document.error(
                    place("KHR_materials_ior.ior"),
                    format!("{} is neither 0 nor at least 1", material.ior),
                ));
            }
        }
        if let Some(extension) = &extensions.specular {
            let place = place("KHR_materials_specular");
            material.specular = self.fraction("specularFactor", extension.specular_factor);
            material.specular_texture = textures.read(
                extension.specular_texture.as_ref(),
                &format!("{place}.specularTexture"),
                scene,
            );
            // May exceed 1: the reflectance is clamped, not the tint.
            material.specular_color = Vec3::from(extension.specular_color_factor).max(Vec3::ZERO);
            material.specular_color_texture = textures.read(
                extension.specular_color_texture.as_ref(),
                &format!("{place}.specularColorTexture"),
                scene,
            );
        }
        if let Some(extension) = &extensions.transmission {
            let place = place("KHR_materials_transmission");
            material.transmission =
                self.fraction("transmissionFactor", extension.transmission_factor);
            material.transmission_texture = textures.read(
                extension.transmission_texture.as_ref(),
                &format!("{place}.transmissionTexture"),
                scene,
            );
        }
        if let Some(extension) = &extensions.diffuse_transmission {
            let place = place("KHR_materials_diffuse_transmission");
            material.diffuse_transmission = self.fraction(
                "diffuseTransmissionFactor",
                extension.diffuse_transmission_factor,
            );
            material.diffuse_transmission_texture = textures.read(
                extension.diffuse_transmission_texture.as_ref(),
                &format!("{place}.diffuseTransmissionTexture"),
                scene,
            );
            material.diffuse_transmission_color = extension
                .diffuse_transmission_color_factor
                .map(|channel| self.fraction("diffuseTransmissionColorFactor", channel))
                .into();
            material.diffuse_transmission_color_texture = textures.read(
                extension.diffuse_transmission_color_texture.as_ref(),
                &format!("{place}.diffuseTransmissionColorTexture"),
                scene,
            );
        }
        // Thickness 0 is a thin wall. Ray tracing determines the actual thickness of a solid.
        if let Some(extension) = &extensions.volume
            && extension.thickness_factor > 0.0
        {
            let attenuation_distance = extension.attenuation_distance.unwrap_or(f32::INFINITY);
            if attenuation_distance <= 0.0 {
                return Err(self.document.error(
                    place("KHR_materials_volume.attenuationDistance"),
                    format!("{attenuation_distance} is not positive"),
                ));
            }
            let color = extension.attenuation_color;
            material.volume = Some(Volume {
                attenuation_distance,
                attenuation_color: color
                    .map(|channel| self.fraction("attenuationColor", channel))
                    .into(),
            });
        }
        Ok(())
    }

    /// KHR_materials_pbrSpecularGlossiness: a dielectric (diffuse under a mirror-like coat) whose reflectance at normal
    /// incidence is the specular colour. An index of refraction of 0 means a reflectance of 1, which that colour tints.
    fn specular_glossiness(
        &self,
        model: &schema::SpecularGlossiness,
        material: &mut Material,
        textures: &mut Textures,
        scene: &mut Scene,
    ) -> Result<(), ImportError> {
        let place = format!(
            "{}.extensions.KHR_materials_pbrSpecularGlossiness",
            self.place
        );
        let glossiness = self.fraction("glossinessFactor", model.glossiness_factor);
        material.base_color = self.color("diffuseFactor", model.diffuse_factor);
        material.base_color_texture = textures.read(
            model.diffuse_texture.as_ref(),
            &format!("{place}.diffuseTexture"),
            scene,
        );
        material.metallic = 0.0;
        material.roughness = 1.0 - glossiness;
        material.ior = 0.0;
        material.specular_color = model
            .specular_factor
            .map(|channel| self.fraction("specularFactor", channel))
            .into();
        if let Some(info) = &model.specular_glossiness_texture
            && let Some(texture) = textures.read(
                Some(info),
                &format!("{place}.specularGlossinessTexture"),
                scene,
            )
        {
            material.specular_color_texture = Some(texture);
            material.metallic_roughness_texture =
                Some(textures.roughness(info, texture, glossiness, scene)?);
            material.roughness = 1.0;
        }
        Ok(())
    }

    fn alpha_mode(&self) -> Result<AlphaMode, ImportError> {
        match self.source.alpha_mode.as_deref() {
            None | Some("OPAQUE") => Ok(AlphaMode::Opaque),
            Some("MASK") => Ok(AlphaMode::Mask {
                cutoff: self.source.alpha_cutoff.unwrap_or(0.5),
            }),
            Some("BLEND") => Ok(AlphaMode::Blend),
            Some(other) => Err(self.document.error(
                format!("{}.alphaMode", self.place),
                format!("\"{}\" is no alpha mode", quoted(other)),
            )),
        }
    }

    fn color(&self, what: &str, factor: [f32; 4]) -> Vec4 {
        factor.map(|channel| self.fraction(what, channel)).into()
    }

    /// `value` clamped to 0..1, as glTF requires, with a warning if it was outside.
    fn fraction(&self, what: &str, value: f32) -> f32 {
        let fraction = value.clamp(0.0, 1.0);
        if fraction != value {
            self.document.warn(
                &self.place,
                format!("{what} {value} is outside 0..1; {fraction} is used"),
            );
        }
        fraction
    }
}

/// KHR_materials_unlit: the base colour is shown regardless of lighting, and emission is ignored. This is equivalent to
/// a surface that reflects nothing and emits its base colour.
fn show_unlit(material: &mut Material) {
    let alpha = material.base_color.w;
    material.model = MaterialModel::MetallicRoughness;
    material.emissive = material.base_color.truncate();
    material.emissive_texture = material.base_color_texture;
    material.base_color = Vec3::ZERO.extend(alpha);
    if material.alpha_mode == AlphaMode::Opaque {
        material.base_color_texture = None;
    }
    material.metallic = 0.0;
    material.roughness = 1.0;
    material.metallic_roughness_texture = None;
    material.specular = 0.0;
}
