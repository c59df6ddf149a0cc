//! Draws fitted leaves with wgpu, headless or in a window. Takes plain scene data; knows nothing of fitting or files of scenes.

pub mod scene;
