//! Frames with noise against pictures of many samples.
