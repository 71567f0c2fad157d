//! Skins and animations.

use glam::{Mat4, Vec3};

use super::document::Document;
use super::schema::{self, AnimationSampler};
use crate::animation::{Animation, Channel, Interpolation, Property, Rig, Skin};
use crate::import::quoted;
use crate::{ImportError, origin};

/// Memory of a joint of a skin (bytes): its node, its matrix at rest and its matrix in a pose.
const SKIN_JOINT_BYTES: u64 = 8 + 2 * 64;

/// Adds the file's skins to `rig`.
pub fn read_skins(document: &Document, rig: &mut Rig) -> Result<(), ImportError> {
    for (index, source) in document.root.skins.iter().enumerate() {
        let place = format!("skins[{index}]");
        for &joint in &source.joints {
            document.get(&rig.nodes, "node", joint, &format!("{place}.joints"))?;
        }
        let bytes = size_of::<Skin>() as u64 + source.joints.len() as u64 * SKIN_JOINT_BYTES;
        document.charge(bytes, 1, &place)?;
        let joint_from_mesh = match source.inverse_bind_matrices {
            None => vec![Mat4::IDENTITY; source.joints.len()],
            Some(accessor) => {
                let place = format!("{place}.inverseBindMatrices");
                document.charge(document.count(accessor, &place)?, 64, &place)?;
                let matrices = document.floats::<16>(accessor, &place)?;
                if matrices.len() < source.joints.len() {
                    return Err(document.error(
                        place,
                        format!(
                            "{} matrices for {} joints",
                            matrices.len(),
                            source.joints.len()
                        ),
                    ));
                }
                let matrices = matrices.iter().take(source.joints.len());
                matrices.map(Mat4::from_cols_array).collect()
            }
        };
        rig.skins.push(Skin {
            joints: source.joints.clone(),
            joint_from_mesh,
        });
    }
    Ok(())
}

/// Adds the file's animations to `rig`.
pub fn read_animations(document: &Document, rig: &mut Rig) -> Result<(), ImportError> {
    for (index, source) in document.root.animations.iter().enumerate() {
        let place = format!("animations[{index}]");
        let mut channels = Vec::with_capacity(source.channels.len());
        for (at, channel) in source.channels.iter().enumerate() {
            let place = format!("{place}.channels[{at}]");
            channels.extend(read_channel(document, source, channel, &place, rig)?);
        }
        let ends = channels.iter().filter_map(|channel| channel.times.last());
        rig.animations.push(Animation {
            name: source
                .name
                .clone()
                .unwrap_or_else(|| format!("animation {index}")),
            duration: ends.copied().fold(0.0, f32::max),
            channels,
        });
    }
    Ok(())
}

/// Reads a channel. `None` if it targets no node, which extensions may require, or, with a warning, if its target path
/// is unknown.
fn read_channel(
    document: &Document,
    animation: &schema::Animation,
    channel: &schema::Channel,
    place: &str,
    rig: &Rig,
) -> Result<Option<Channel>, ImportError> {
    let Some(node) = channel.target.node else {
        return Ok(None);
    };
    let target_place = format!("{place}.target");
    let target = document.get(&rig.nodes, "node", node, &target_place)?;
    let (property, width) = match channel.target.path.as_str() {
        "translation" => (Property::Translation, 3),
        "rotation" => (Property::Rotation, 4),
        "scale" => (Property::Scale, 3),
        "weights" => (Property::Weights, target.weights.len()),
        other => {
            document.warn(
                &target_place,
                format!("\"{}\" is not animated", quoted(other)),
            );
            return Ok(None);
        }
    };
    let sampler = document.get(
        &animation.samplers,
        "sampler",
        channel.sampler,
        &format!("{place}.sampler"),
    )?;
    let interpolation = match sampler.interpolation.as_str() {
        "STEP" => Interpolation::Step,
        "LINEAR" => Interpolation::Linear,
        "CUBICSPLINE" => Interpolation::CubicSpline,
        other => {
            return Err(document.error(place, format!("\"{}\" is no interpolation", quoted(other))));
        }
    };
    let times = read_times(document, sampler, place)?;
    let values = read_values(document, sampler, property, place)?;
    let key_width = match interpolation {
        Interpolation::CubicSpline => width * 3,
        _ => width,
    };
    if values.len() != times.len() * key_width {
        return Err(document.error(
            format!("{place}.sampler.output"),
            format!(
                "{} numbers for {} keys of {key_width}",
                values.len(),
                times.len()
            ),
        ));
    }
    if property == Property::Translation {
        let places = values.as_chunks::<3>().0.iter();
        let places = places.map(|&place| Vec3::from(place).as_dvec3());
        if let Some(step) = origin::corners_of(places).and_then(origin::coarse_step) {
            let place = format!("{place}.sampler.output");
            document.warn(&place, origin::coarse_positions(step));
        }
    }
    Ok(Some(Channel {
        node,
        property,
        interpolation,
        times,
        values,
    }))
}

fn read_times(
    document: &Document,
    sampler: &AnimationSampler,
    place: &str,
) -> Result<Vec<f32>, ImportError> {
    let place = format!("{place}.sampler.input");
    document.charge(document.count(sampler.input, &place)?, 4, &place)?;
    let times = document.floats::<1>(sampler.input, &place)?;
    let times: Vec<f32> = times.into_iter().map(|[time]| time).collect();
    if times.is_empty() {
        return Err(document.error(place, "there are no keys"));
    }
    if times[0] < 0.0 || !times.is_sorted_by(|a, b| a < b) {
        return Err(document.error(place, "times must increase from 0"));
    }
    Ok(times)
}

fn read_values(
    document: &Document,
    sampler: &AnimationSampler,
    property: Property,
    place: &str,
) -> Result<Vec<f32>, ImportError> {
    let place = format!("{place}.sampler.output");
    let width = document.width(sampler.output, &place)?;
    document.charge(document.count(sampler.output, &place)?, 4 * width, &place)?;
    Ok(match property {
        Property::Translation | Property::Scale => document
            .floats::<3>(sampler.output, &place)?
            .into_flattened(),
        Property::Rotation => document
            .floats::<4>(sampler.output, &place)?
            .into_flattened(),
        Property::Weights => document
            .floats::<1>(sampler.output, &place)?
            .into_flattened(),
    })
}
