//! Built-in scenes: procedural, each a few lines to read.
