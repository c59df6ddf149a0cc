//! The command line as a user meets it: usage, bad tables, bad places, messages, Ctrl-C, and that nothing is
//! overwritten.
//!
//! These tests are one program, because building a program for each of them takes longer than running most of them.

mod bad_input;
#[path = "../blade/mod.rs"]
mod blade;
mod claim;
mod commands;
#[path = "../common/mod.rs"]
mod common;
mod container;
mod csv;
mod evidence;
mod floors;
mod inspect_file;
mod interrupted;
mod layout;
mod licences;
mod limits;
mod links;
mod makefile;
mod mangled;
mod messages;
mod python;
mod scene_fields;
mod tables;
