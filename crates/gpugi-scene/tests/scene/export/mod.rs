//! Bakes as glTF files: what must change does, what need not stays.

mod baking;
mod changes;
mod hostile;
mod mapping;
mod materials;
mod panes;
mod preserved;
mod scenes;
mod spheres;
mod splits;
mod transfer;
