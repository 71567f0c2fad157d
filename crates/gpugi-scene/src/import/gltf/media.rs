//! `extras.gpugi.medium` of nodes and scenes: fog, smoke and clouds (docs/media.md).

use std::collections::HashMap;
use std::sync::Arc;

use glam::{Mat4, Vec3};
use serde::Deserialize;
use serde_json::Value;

use super::document::Document;
use super::uri;
use crate::image::{decode_nanovdb, decode_volume, is_nanovdb};
use crate::import::quoted;
use crate::{DensityGrid, ImportError, MAX_MEDIA, Medium, Name, PhaseFunction, Resolver};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MediumExtras {
    extinction: Vec3,
    #[serde(default = "ones")]
    albedo: Vec3,
    #[serde(default)]
    g: f32,
    #[serde(default)]
    phase: Phase,
    #[serde(default)]
    emission: Vec3,
    density: Option<String>,
}

#[derive(Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
enum Phase {
    #[default]
    HenyeyGreenstein,
    CornetteShanks,
}

fn ones() -> Vec3 {
    Vec3::ONE
}

/// Reads media. Those that name the same volume share it.
pub struct Media<'a> {
    document: &'a Document<'a>,
    resolver: &'a dyn Resolver,
    volumes: HashMap<String, Arc<DensityGrid>>,
    /// Media so far.
    count: usize,
}

impl<'a> Media<'a> {
    pub fn new(document: &'a Document<'a>, resolver: &'a dyn Resolver) -> Self {
        Self {
            document,
            resolver,
            volumes: HashMap::new(),
            count: 0,
        }
    }

    /// The medium of the extras of a node or scene at `place`, if they have one. `world_from_box` is `None` for a scene.
    pub fn read(
        &mut self,
        extras: &Value,
        place: &str,
        name: Name,
        world_from_box: Option<Mat4>,
        node: Option<usize>,
    ) -> Result<Option<Medium>, ImportError> {
        let Some(value) = extras.get("gpugi").and_then(|own| own.get("medium")) else {
            return Ok(None);
        };
        let document = self.document;
        let place = format!("{place}.extras.gpugi.medium");
        self.count += 1;
        if self.count > MAX_MEDIA {
            let reason = format!("a scene has at most {MAX_MEDIA} media");
            return Err(document.error(place, reason));
        }
        let extras =
            MediumExtras::deserialize(value).map_err(|error| document.error(&place, error))?;
        document.charge(1, size_of::<Medium>(), &place)?;
        if world_from_box.is_none() && extras.density.is_some() {
            let reason = "a medium that fills everything has no box for a density";
            return Err(document.error(place, reason));
        }
        let density = match &extras.density {
            Some(uri) => Some(self.volume(uri, &format!("{place}.density"))?),
            None => None,
        };
        let medium = Medium {
            name,
            world_from_box,
            extinction: extras.extinction,
            albedo: extras.albedo,
            phase: match extras.phase {
                Phase::HenyeyGreenstein => PhaseFunction::HenyeyGreenstein(extras.g),
                Phase::CornetteShanks => PhaseFunction::CornetteShanks(extras.g),
            },
            emission: extras.emission,
            density,
            node,
        };
        medium
            .check()
            .map_err(|reason| document.error(place, reason))?;
        Ok(Some(medium))
    }

    fn volume(&mut self, uri: &str, place: &str) -> Result<Arc<DensityGrid>, ImportError> {
        if let Some(known) = self.volumes.get(uri) {
            return Ok(known.clone());
        }
        let document = self.document;
        let bytes = uri::read(uri, self.resolver);
        let bytes = bytes.map_err(|reason| document.error(place, reason))?;
        document.given(uri, bytes.len());
        let label = if uri.starts_with("data:") {
            "volume"
        } else {
            uri
        };
        let label = quoted(label);
        let decode = if is_nanovdb(&bytes) {
            decode_nanovdb
        } else {
            decode_volume
        };
        let volume = decode(&label, &bytes, &document.budget).map_err(|error| {
            let reason = format!("\"{label}\": {}: {}", error.place, error.reason);
            document.error(place, reason)
        })?;
        let volume = Arc::new(volume);
        self.volumes.insert(uri.to_owned(), volume.clone());
        Ok(volume)
    }
}
