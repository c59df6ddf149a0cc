//! Each form is written here from its definition and read again, whole, cut off and damaged.

mod forms;
mod real;
mod rough;
mod workbook;
mod writers;
