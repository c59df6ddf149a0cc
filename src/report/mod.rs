//! Rows to JSON, Markdown and HTML. Computes nothing new.
pub mod rows;
