//! Techniques, each against closed forms, the path tracer and what it must never do.

mod caustics;
#[path = "../common/mod.rs"]
mod common;
mod distance_impostor;
mod environment_map;
mod environment_texels;
mod final_gather;
mod image_based_lighting;
mod light_path_map;
mod participating_media;
mod radiance_transfer;
mod radiosity;
mod ray_tracing;
mod see_through;
mod shadow_map;
mod soft_shadows;
mod spot_warp;
