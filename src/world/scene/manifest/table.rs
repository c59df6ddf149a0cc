//! A table whose fields depend on its kind. Its reader asks for the fields that this kind has, one by one, and refuses
//! the rest.

use crate::manifest::{Error, Result};
use mesophyll_base::error::Fault;
use serde::Deserialize;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

/// A table of a scene file while it is read.
pub struct StatedTable<'a> {
    /// The file's path and its text.
    file: (&'a Path, &'a str),
    header: &'static str,
    /// The table in errors, such as `view "a"`.
    pub called: String,
    /// Where it begins in the text.
    start: usize,
    fields: DeTable<'a>,
    known: Vec<&'static str>,
}

impl<'a> StatedTable<'a> {
    /// Takes the `[[header]]` tables out of the file.
    ///
    /// # Errors
    /// [`Error::Input`] where something else has this name.
    pub fn all(file: (&'a Path, &'a str), root: &mut DeTable<'a>, header: &'static str) -> Result<Vec<Self>> {
        let wrong = |start: usize, found: &DeValue| {
            fault(file, start, header, format!("found {}, expected [[{header}]] tables", found.type_str()))
        };
        let Some(list) = root.remove(header) else { return Ok(Vec::new()) };
        let DeValue::Array(tables) = list.get_ref() else { return Err(wrong(list.span().start, list.get_ref())) };
        tables
            .iter()
            .map(|t| StatedTable::of(file, t, header).ok_or_else(|| wrong(t.span().start, t.get_ref())))
            .collect()
    }

    /// Takes the `[header]` table out of the file.
    ///
    /// # Errors
    /// [`Error::Input`] where something else has this name.
    pub fn one(file: (&'a Path, &'a str), root: &mut DeTable<'a>, header: &'static str) -> Result<Option<Self>> {
        let Some(value) = root.remove(header) else { return Ok(None) };
        let what = || format!("found {}, expected a [{header}] table", value.get_ref().type_str());
        let table = StatedTable::of(file, &value, header);
        table.map(Some).ok_or_else(|| fault(file, value.span().start, header, what()))
    }

    fn of(file: (&'a Path, &'a str), value: &Spanned<DeValue<'a>>, header: &'static str) -> Option<Self> {
        let DeValue::Table(fields) = value.get_ref() else { return None };
        let (called, start) = (format!("a {header}"), value.span().start);
        Some(StatedTable { file, header, called, start, fields: fields.clone(), known: Vec::new() })
    }

    /// Whether the table has this field and it was not asked for yet.
    pub fn has(&self, key: &str) -> bool {
        self.fields.contains_key(key)
    }

    /// The table's name, by which errors call it from now on.
    ///
    /// # Errors
    /// As [`StatedTable::needed`].
    pub fn name(&mut self) -> Result<String> {
        let name = self.needed("name")?;
        self.called = format!("{} \"{name}\"", self.header);
        Ok(name)
    }

    /// A field that the table must have.
    ///
    /// # Errors
    /// [`Error::Input`] where it is missing or holds something else.
    pub fn needed<T: Deserialize<'a>>(&mut self, key: &'static str) -> Result<T> {
        self.stated(key)?.ok_or_else(|| self.missing(key, &format!("missing; {} needs it", self.called)))
    }

    /// A field that the table may have.
    ///
    /// # Errors
    /// [`Error::Input`] where it holds something else.
    pub fn stated<T: Deserialize<'a>>(&mut self, key: &'static str) -> Result<Option<T>> {
        self.known.push(key);
        let Some(value) = self.fields.remove(key) else { return Ok(None) };
        let start = value.span().start;
        T::deserialize(ValueDeserializer::from(value)).map(Some).map_err(|e| {
            let what = e.message().lines().collect::<Vec<_>>().join(" ");
            self.fault(e.span().map_or(start, |span| span.start), key, what)
        })
    }

    /// A field that this kind does not have, but that may be given where it says what is so without it.
    ///
    /// # Errors
    /// [`Error::Input`] where it holds something that no kind has.
    pub fn default_only<T: Deserialize<'a> + Default + PartialEq>(&mut self, key: &'static str) -> Result<Option<T>> {
        let kept = self.fields.get_key_value(key).map(|(key, value)| (key.clone(), value.clone()));
        let found = self.stated(key)?.filter(|found| *found == T::default());
        self.known.pop();
        if let (None, Some((key, value))) = (&found, kept) {
            self.fields.insert(key, value);
        }
        Ok(found)
    }

    /// The line and the name of a field that nobody asked for and that is spelt almost like this one.
    pub fn near(&self, key: &str) -> Option<(usize, &str)> {
        let near = |name: &str| changes(name, key) <= key.len() / 3 && !self.known.contains(&name);
        let found = self.fields.keys().find(|name| near(name.get_ref()))?;
        Some((found.span().start, found.get_ref()))
    }

    /// The error for a field that is missing, or for the one that was meant to be it.
    pub fn missing(&self, key: &str, what: &str) -> Error {
        match self.near(key) {
            Some((start, name)) => self.fault(start, name, format!("no field of {}; expected {key}", self.called)),
            None => self.fault(self.start, key, what.into()),
        }
    }

    /// Refuses what was not asked for. `why` says what the table is.
    ///
    /// # Errors
    /// [`Error::Input`] naming the first such field and the fields that this kind has.
    pub fn finish(self, why: &str) -> Result<()> {
        let Some((key, _)) = self.fields.iter().next() else { return Ok(()) };
        let known = self.known.join(", ");
        // A misspelt name has most letters of the one that is meant.
        let near = self.known.iter().map(|name| (changes(key.get_ref(), name), name)).min();
        let meant = near
            .filter(|near| near.0 <= key.get_ref().len() / 3)
            .map_or(String::new(), |(_, name)| format!("{name} of "));
        let what = format!("given{why}; expected {meant}its fields {known}");
        Err(self.fault(key.span().start, key.get_ref(), what))
    }

    fn fault(&self, start: usize, key: &str, what: String) -> Error {
        fault(self.file, start, &format!("{}.{key}", self.header), what)
    }
}

fn fault((path, text): (&Path, &str), start: usize, field: &str, what: String) -> Error {
    Error::Input {
        file: path.display().to_string(),
        line: u32::try_from(text[..start.min(text.len())].matches('\n').count() + 1).ok(),
        field: Some(field.into()),
        fault: Fault::Other(what),
    }
}

/// How many letters have to be written, left out or exchanged to turn one word into the other.
fn changes(from: &str, to: &str) -> usize {
    let mut row: Vec<usize> = (0..=to.chars().count()).collect();
    for (i, a) in from.chars().enumerate() {
        let mut corner = std::mem::replace(&mut row[0], i + 1);
        for (j, b) in to.chars().enumerate() {
            let other = corner + usize::from(a != b);
            corner = row[j + 1];
            row[j + 1] = other.min(corner + 1).min(row[j] + 1);
        }
    }
    row.last().copied().unwrap_or_default()
}
