//! Visibility maps for many directions in few bytes. Each can be decoded by itself.

use super::directions::ShadowDirections;
use super::entropy::{Counts, Model, take};
use super::receivers::MOST_RECEIVERS;
use super::runs;
use crate::{Error, Result};
use glam::DVec3;
use mesophyll_files::{atomic, hash};
use rayon::prelude::*;
use std::path::Path;

/// Collects maps for [`CodedMaps`]. Until all of them have arrived, they are stored as run lengths.
#[derive(Debug, Clone)]
pub struct MapCollector {
    receivers: usize,
    counts: Box<Counts>,
    maps: Vec<Vec<u8>>,
}

impl MapCollector {
    /// A collector of maps with this number of receivers.
    pub fn new(receivers: usize) -> MapCollector {
        MapCollector { receivers, counts: Box::default(), maps: Vec::new() }
    }

    /// Adds the map of the next direction.
    ///
    /// # Errors
    /// [`Error::Usage`] for a map of another length.
    pub fn push(&mut self, map: &[u8]) -> Result<()> {
        if map.len() != self.receivers {
            return Err(Error::Usage(format!("a map of {} receivers, expected {}", map.len(), self.receivers)));
        }
        self.counts.add(map);
        self.maps.push(runs::encode(map));
        Ok(())
    }

    /// Number of bytes that the maps take as run lengths, which is the source's code.
    pub fn run_length_bytes(&self) -> usize {
        self.maps.iter().map(Vec::len).sum()
    }

    /// Codes the maps. `directions` has one direction for each.
    ///
    /// # Errors
    /// [`Error::Usage`] where there are more or fewer maps than directions.
    pub fn finish(self, directions: ShadowDirections) -> Result<CodedMaps> {
        if self.maps.len() != directions.len() {
            let count = self.maps.len();
            return Err(Error::Usage(format!("{count} maps for {} directions", directions.len())));
        }
        let model = Model::new(&self.counts);
        let each: Vec<Vec<u8>> = self
            .maps
            .par_iter()
            .map_init(
                || vec![0; self.receivers],
                |map, coded| {
                    runs::decode(coded, map).map_err(|why| Error::Usage(format!("visibility maps: {why}")))?;
                    Ok(model.encode(map))
                },
            )
            .collect::<Result<_>>()?;
        let mut ends = Vec::with_capacity(each.len());
        let mut data = Vec::with_capacity(each.iter().map(Vec::len).sum());
        for map in each {
            data.extend(map);
            ends.push(data.len());
        }
        Ok(CodedMaps { receivers: self.receivers, directions, model, ends, data })
    }
}

/// Maps for many directions. Each is decoded by itself.
#[derive(Debug, Clone, PartialEq)]
pub struct CodedMaps {
    receivers: usize,
    directions: ShadowDirections,
    model: Model,
    /// The end of each map in `data`.
    ends: Vec<usize>,
    data: Vec<u8>,
}

/// The first bytes of a file. The last one is the version of the format.
const MAGIC: [u8; 8] = *b"mesovis\x01";
/// Number of hexadecimal digits in the hash at the end of a file.
const HASH: usize = 64;

impl CodedMaps {
    /// The directions that have a map.
    pub fn directions(&self) -> &ShadowDirections {
        &self.directions
    }

    /// Number of receivers in a map.
    pub fn receivers(&self) -> usize {
        self.receivers
    }

    /// Number of bytes of a file with these maps and all that they share.
    pub fn bytes(&self) -> usize {
        self.to_bytes().len()
    }

    /// Decodes the map of direction `k` of the list into `map`, which has an entry for each receiver.
    ///
    /// # Errors
    /// [`Error::Usage`] for a direction without a map, a `map` of another length, or data that are not a map's.
    pub fn decode(&self, k: usize, map: &mut [u8]) -> Result<()> {
        let bad = |what: String| Error::Usage(format!("visibility map {k}: {what}"));
        if map.len() != self.receivers {
            return Err(bad(format!("{} receivers, expected {}", map.len(), self.receivers)));
        }
        let end = *self.ends.get(k).ok_or_else(|| bad(format!("expected one of {}", self.ends.len())))?;
        let start = k.checked_sub(1).map_or(0, |before| self.ends[before]);
        self.model.decode(&self.data[start..end], map).map_err(bad)
    }

    /// The map for a light between the directions: a mixture of the maps around it ([`ShadowDirections::blend`]). It is
    /// dark where there are none.
    ///
    /// # Errors
    /// As [`CodedMaps::decode`].
    pub fn between(&self, light: DVec3, map: &mut [u8]) -> Result<()> {
        let blend = self.directions.blend(light);
        if let [(k, _)] = blend[..] {
            return self.decode(k, map);
        }
        let (mut sum, mut one) = (vec![0.5; self.receivers], vec![0; self.receivers]);
        for (k, share) in blend {
            self.decode(k, &mut one)?;
            sum.iter_mut().zip(&one).for_each(|(sum, value)| *sum += share as f32 * f32::from(*value));
        }
        if map.len() != self.receivers {
            return Err(Error::Usage(format!("a map of {} receivers, expected {}", map.len(), self.receivers)));
        }
        map.iter_mut().zip(sum).for_each(|(value, sum)| *value = sum as u8);
        Ok(())
    }

    /// Writes the maps to a file: directions, tables, lengths, maps, and a hash of everything.
    ///
    /// # Errors
    /// [`Error::Write`] naming the file.
    pub fn write(&self, path: &Path) -> Result<()> {
        atomic::write_bytes(path, &self.to_bytes())
    }

    /// Reads a file of [`CodedMaps::write`].
    ///
    /// # Errors
    /// [`Error::Input`] that names the file, where it is missing, damaged or not such a file.
    pub fn read(path: &Path) -> Result<CodedMaps> {
        let bytes = std::fs::read(path).map_err(|e| Error::input(path, atomic::explain(&e)))?;
        CodedMaps::from_bytes(&bytes).map_err(|what| Error::input(path, format!("visibility maps: {what}")))
    }

    fn to_bytes(&self) -> Vec<u8> {
        let mut out = MAGIC.to_vec();
        out.extend((self.receivers as u32).to_le_bytes());
        self.directions.write(&mut out);
        self.model.write(&mut out);
        let mut start = 0;
        for end in &self.ends {
            out.extend(((end - start) as u32).to_le_bytes());
            start = *end;
        }
        out.extend(&self.data);
        out.extend(hash::bytes(&out).into_bytes());
        out
    }

    /// Parses a file. For any content it takes at most three times the bytes and 20 MB of memory.
    fn from_bytes(bytes: &[u8]) -> std::result::Result<CodedMaps, String> {
        let (mut rest, found) = bytes.split_last_chunk::<HASH>().ok_or("it is cut off")?;
        if !rest.starts_with(&MAGIC) {
            return Err("it is no file of visibility maps, or one of another version".into());
        }
        if hash::bytes(rest).as_bytes() != found {
            return Err("it is not what was written: its hash differs".into());
        }
        CodedMaps::parse(&mut rest)
    }

    /// Parses everything except the hash.
    fn parse(rest: &mut &[u8]) -> std::result::Result<CodedMaps, String> {
        let _: [u8; MAGIC.len()] = take(rest)?;
        let receivers = u32::from_le_bytes(take(rest)?) as usize;
        if receivers > MOST_RECEIVERS {
            return Err(format!("{receivers} receivers, expected at most {MOST_RECEIVERS}"));
        }
        let directions = ShadowDirections::read(rest)?;
        let model = Model::read(rest)?;
        if rest.len() < 4 * directions.len() {
            return Err("it is cut off".into());
        }
        let (mut end, mut ends) = (0, Vec::with_capacity(directions.len()));
        for _ in 0..directions.len() {
            end += u32::from_le_bytes(take(rest)?) as usize;
            ends.push(end);
        }
        if rest.len() != end {
            return Err(format!("maps of {} bytes, expected {end}", rest.len()));
        }
        Ok(CodedMaps { receivers, directions, model, ends, data: rest.to_vec() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A map with lengths and values as leaves have them: dark and lit runs, with penumbras between them.
    fn map(receivers: usize, seed: u64) -> Vec<u8> {
        let mut out = Vec::new();
        for k in 0.. {
            let random = crate::seeds::mix(seed, k);
            let value = [0, 255, random as u8, 255][random as usize >> 9 & 3];
            let length = [1, 3, 40, 1000][random as usize >> 30 & 3];
            out.extend(vec![value; 1 + (random >> 40) as usize % length]);
            if out.len() >= receivers {
                break;
            }
        }
        out.truncate(receivers);
        out
    }

    fn coded(maps: &[Vec<u8>]) -> CodedMaps {
        let mut collector = MapCollector::new(maps[0].len());
        maps.iter().for_each(|map| collector.push(map).unwrap());
        let path: Vec<DVec3> = (0..maps.len()).map(|k| DVec3::new(1.0, 0.0, 0.01 * k as f64)).collect();
        collector.finish(ShadowDirections::arc(&path).unwrap()).unwrap()
    }

    fn decoded(coded: &CodedMaps, k: usize) -> Vec<u8> {
        let mut map = vec![7; coded.receivers()];
        coded.decode(k, &mut map).unwrap();
        map
    }

    proptest! {
        // Building a model's tables takes longer than coding such short maps.
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn whatever_the_maps_are_they_come_back(
            maps in (0usize..600).prop_flat_map(|n| {
                let one = prop_oneof![
                    proptest::collection::vec(any::<u8>(), n),
                    proptest::collection::vec(prop_oneof![Just(0u8), Just(255), 1..255u8], n),
                    any::<u8>().prop_map(move |v| vec![v; n]),
                    any::<u64>().prop_map(move |seed| map(n, seed)),
                ];
                proptest::collection::vec(one, 1..5)
            })
        ) {
            let there = coded(&maps);
            let back = CodedMaps::from_bytes(&there.to_bytes()).unwrap();
            prop_assert_eq!(&there, &back);
            for (k, map) in maps.iter().enumerate() {
                prop_assert_eq!(&decoded(&back, k), map);
                let mut run_lengths = vec![1; map.len()];
                runs::decode(&runs::encode(map), &mut run_lengths).unwrap();
                prop_assert_eq!(&run_lengths, map);
            }
        }

        /// Damage to a file is found by its hash. Where the hash is made to fit the damage, nothing panics, and a
        /// refusal gives its reason.
        #[test]
        fn damage_is_refused(at in 0usize..4000, bit in 0u8..8, cut in 0usize..4000) {
            let whole = coded(&[map(3000, 1), map(3000, 2), map(3000, 3)]).to_bytes();
            let mut damaged = whole.clone();
            let at = at % damaged.len();
            damaged[at] ^= 1 << bit;
            prop_assert!(CodedMaps::from_bytes(&damaged).is_err());
            prop_assert!(CodedMaps::from_bytes(&whole[..cut % whole.len()]).is_err());
            for mut made in [&damaged[..damaged.len() - HASH], &whole[..cut % (whole.len() - HASH)]] {
                if let Ok(maps) = CodedMaps::parse(&mut made) {
                    // The number of receivers may be damaged too.
                    let mut map = vec![0; maps.receivers().min(4000)];
                    (0..3).for_each(|k| drop(maps.decode(k, &mut map)));
                }
            }
            let mut map = vec![0; 3000];
            let _ = runs::decode(&damaged, &mut map);
        }
    }

    /// Even without the hash, a changed bit in a map's own bytes is nearly always found: the state does not return to
    /// its initial value.
    #[test]
    fn a_map_that_is_damaged_does_not_end_where_it_should() {
        let there = coded(&[map(3000, 2), map(3000, 3)]);
        let mut found = 0;
        for at in 0..there.data.len() {
            let mut damaged = there.clone();
            damaged.data[at] ^= 16;
            found += usize::from((0..2).any(|k| damaged.decode(k, &mut vec![0; 3000]).is_err()));
        }
        assert!(found * 100 >= there.data.len() * 98, "{found} of {}", there.data.len());
    }

    #[test]
    fn between_two_maps_lies_their_mixture() {
        let maps = [vec![0, 255, 100, 7], vec![255, 255, 200, 8]];
        let there = coded(&maps);
        let mut map = vec![0; 4];
        let [a, b] = [0, 1].map(|k| there.directions().list()[k]);
        there.between(a + b, &mut map).unwrap();
        assert_eq!(map, [128, 255, 150, 8]);
        there.between(b, &mut map).unwrap();
        assert_eq!(map, maps[1]);
        assert!(there.between(a + b, &mut [0; 3]).is_err() && there.between(b, &mut [0; 3]).is_err());
        assert!(there.decode(2, &mut map).is_err());
    }

    #[test]
    fn files_are_read_back_and_others_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("maps");
        let there = coded(&[map(500, 1), map(500, 9)]);
        there.write(&path).unwrap();
        assert_eq!(CodedMaps::read(&path).unwrap(), there);
        std::fs::write(&path, b"a note that is longer than any hash could be, and says nothing of maps at all")
            .unwrap();
        let said = CodedMaps::read(&path).unwrap_err().to_string();
        assert!(said.ends_with("maps: visibility maps: it is no file of visibility maps, or one of another version"));
        assert!(CodedMaps::read(&folder.path().join("none")).is_err());
        let mut collector = MapCollector::new(4);
        assert!(collector.push(&[0; 3]).is_err());
        assert!(collector.finish(ShadowDirections::one(DVec3::Z).unwrap()).is_err());
    }
}
