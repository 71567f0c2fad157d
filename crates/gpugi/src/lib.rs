//! gpugi
