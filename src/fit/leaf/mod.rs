pub mod blade;
mod fill;
