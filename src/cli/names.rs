//! Values that are named alike in files and on the command line: a library's enum is the list of names, and its
//! documentation their help.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use std::str::FromStr;
use strum::{EnumMessage, IntoEnumIterator};

/// Reads one of the names of `T`.
pub fn named<T>() -> impl TypedValueParser<Value = T>
where
    T: IntoEnumIterator + EnumMessage + Into<&'static str> + Copy + FromStr<Err = strum::ParseError>,
    T: Send + Sync + 'static,
{
    PossibleValuesParser::new(shown::<T>()).try_map(|name| T::from_str(&name))
}

/// Reads one of the names of `T`, or `other`, which is `None`; `help` says what it means.
pub fn named_or<T>(other: &'static str, help: &'static str) -> impl TypedValueParser<Value = Option<T>>
where
    T: IntoEnumIterator + EnumMessage + Into<&'static str> + Copy + FromStr<Err = strum::ParseError>,
    T: Send + Sync + 'static,
{
    let values = shown::<T>().into_iter().chain([PossibleValue::new(other).help(help)]);
    PossibleValuesParser::new(values.collect::<Vec<_>>())
        .try_map(move |name| if name == other { Ok(None) } else { T::from_str(&name).map(Some) })
}

/// The names of `T` with their help.
fn shown<T>() -> Vec<PossibleValue>
where
    T: IntoEnumIterator + EnumMessage + Into<&'static str> + Copy,
{
    let values = T::iter().map(|value| {
        let help = value.get_documentation().unwrap_or_default().lines().map(str::trim).collect::<Vec<_>>().join(" ");
        let name: &'static str = value.into();
        let others = value.get_serializations().iter().copied().filter(|other| *other != name);
        let shown = PossibleValue::new(name).aliases(others);
        if help.is_empty() { shown } else { shown.help(help) }
    });
    values.collect()
}
