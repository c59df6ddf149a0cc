//! Codes runs in as few bits as their statistics require.
//!
//! A run has two symbols: its value and its length. Their probabilities depend on whether the previous runs were dark,
//! partly lit or lit, because a penumbra lies between dark and lit. For a length, they depend on the classes of the run
//! and of the run before. There are nine such situations for values and nine for lengths. Each has a fixed table of
//! probabilities, which all maps share. Symbols are coded by an asymmetric numeral system (rANS: Duda 2013, §3), with a
//! state of 32 bits, probabilities in units of 1/4,096, and 16 bits at a time. It needs at most a thousandth more than
//! the entropy. Decoding takes a look-up, a multiplication and a shift.
//!
//! Lengths up to 16 are symbols of their own. Longer ones are grouped into half octaves, whose low bits follow
//! unchanged.

use super::runs::runs;

/// Number of bits of a probability.
const BITS: u32 = 12;
const TOTAL: u32 = 1 << BITS;
/// The state is at least this, and below 2³².
const LOWEST: u32 = 1 << 16;
/// Number of situations for values, which is also that for lengths.
const SITUATIONS: usize = 9;
/// Number of symbols for lengths, which go up to 2²⁷.
const LENGTHS: usize = 16 + 2 * 23;

/// The class of a value: dark, lit, or partly lit.
fn class(value: u8) -> usize {
    match value {
        0 => 0,
        255 => 1,
        _ => 2,
    }
}

/// The classes of the last two runs' values.
#[derive(Debug, Clone, Copy)]
struct Situation {
    last: usize,
    before: usize,
}

const START: Situation = Situation { last: 1, before: 0 };

impl Situation {
    fn of_value(self) -> usize {
        3 * self.last + self.before
    }

    fn of_length(self, value: u8) -> usize {
        SITUATIONS + 3 * class(value) + self.last
    }

    fn after(self, value: u8) -> Situation {
        Situation { last: class(value), before: self.last }
    }
}

/// For a length of at least 1: its symbol, its low bits, and their number.
fn length_symbol(length: usize) -> (u8, u32, u32) {
    if length <= 16 {
        return ((length - 1) as u8, 0, 0);
    }
    let octave = length.ilog2();
    let half = length >> (octave - 1) & 1;
    let bits = octave - 1;
    ((16 + 2 * (octave - 4) as usize + half) as u8, (length & ((1 << bits) - 1)) as u32, bits)
}

/// The least length of a symbol, and the number of low bits that follow.
fn length_of(symbol: u8) -> (usize, u32) {
    if symbol < 16 {
        return (usize::from(symbol) + 1, 0);
    }
    let octave = 4 + u32::from(symbol - 16) / 2;
    let half = usize::from(symbol & 1);
    ((2 + half) << (octave - 1), octave - 1)
}

/// How often each symbol occurred in each situation.
#[derive(Debug, Clone)]
pub(super) struct Counts([[u64; 256]; 2 * SITUATIONS]);

impl Default for Counts {
    fn default() -> Self {
        Counts([[0; 256]; 2 * SITUATIONS])
    }
}

impl Counts {
    pub fn add(&mut self, map: &[u8]) {
        let mut now = START;
        for (value, count) in runs(map) {
            self.0[now.of_value()][usize::from(value)] += 1;
            self.0[now.of_length(value)][usize::from(length_symbol(count).0)] += 1;
            now = now.after(value);
        }
    }
}

/// The probabilities of all symbols in all situations.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Model {
    /// A table for each situation, in units of 1/4,096. Each table sums to 4,096.
    shares: Vec<[u16; 256]>,
    /// The meaning of a state's low bits, 4,096 entries for each situation: share − 1, place within the share, and
    /// symbol.
    slots: Vec<u32>,
}

impl Model {
    pub fn new(counts: &Counts) -> Model {
        Model::of(counts.0.iter().map(shares).collect())
    }

    fn of(shares: Vec<[u16; 256]>) -> Model {
        let mut slots = Vec::with_capacity(shares.len() << BITS);
        for table in &shares {
            for (symbol, share) in table.iter().enumerate() {
                slots.extend((0..u32::from(*share)).map(|at| u32::from(share - 1) << 20 | at << 8 | symbol as u32));
            }
        }
        Model { shares, slots }
    }

    /// Appends, for each table, the number of its symbols and then each symbol with its share.
    pub fn write(&self, out: &mut Vec<u8>) {
        for table in &self.shares {
            let known = || table.iter().enumerate().filter(|(_, share)| **share > 0);
            out.extend((known().count() as u16).to_le_bytes());
            for (symbol, share) in known() {
                out.push(symbol as u8);
                out.extend(share.to_le_bytes());
            }
        }
    }

    /// Reads the bytes of [`Model::write`] from the beginning of `bytes`, and removes them.
    pub fn read(bytes: &mut &[u8]) -> Result<Model, String> {
        let mut tables = Vec::with_capacity(2 * SITUATIONS);
        for situation in 0..2 * SITUATIONS {
            let mut table = [0; 256];
            let count = u16::from_le_bytes(take(bytes)?);
            for _ in 0..count.min(256) {
                let [symbol, low, high] = take(bytes)?;
                table[usize::from(symbol)] = u16::from_le_bytes([low, high]);
            }
            let known = table.iter().filter(|share| **share > 0).count();
            let sum: u32 = table.iter().map(|share| u32::from(*share)).sum();
            let beyond = situation >= SITUATIONS && table[LENGTHS..].iter().any(|share| *share > 0);
            if sum != TOTAL || known != usize::from(count) || beyond {
                return Err(format!("table {situation} of the probabilities is none"));
            }
            tables.push(table);
        }
        Ok(Model::of(tables))
    }

    /// Codes a map. Every symbol of it must have been counted.
    pub fn encode(&self, map: &[u8]) -> Vec<u8> {
        let mut symbols = Vec::new();
        let mut now = START;
        for (value, count) in runs(map) {
            let (symbol, low, bits) = length_symbol(count);
            symbols.push(self.share(now.of_value(), value));
            symbols.push(self.share(now.of_length(value), symbol));
            for (part, bits) in parts(bits).map(|(shift, bits)| (low >> shift & ((1 << bits) - 1), bits)) {
                symbols.push((part << (BITS - bits), 1 << (BITS - bits)));
            }
            now = now.after(value);
        }
        // rANS reads symbols in the opposite order in which they were written.
        let (mut state, mut words) = (LOWEST, Vec::new());
        for (start, share) in symbols.into_iter().rev() {
            if u64::from(state) >= u64::from(share) << (32 - BITS) {
                words.push(state as u16);
                state >>= 16;
            }
            state = (state / share) << BITS | (state % share + start);
        }
        let mut out = state.to_le_bytes().to_vec();
        words.iter().rev().for_each(|word| out.extend(word.to_le_bytes()));
        out
    }

    /// The beginning and the size of a symbol's share.
    fn share(&self, situation: usize, symbol: u8) -> (u32, u32) {
        let table = &self.shares[situation];
        let before = table[..usize::from(symbol)].iter().map(|share| u32::from(*share)).sum();
        (before, u32::from(table[usize::from(symbol)]))
    }

    /// Decodes the bytes of [`Model::encode`] into `map`. The error says what is wrong with the bytes.
    pub fn decode(&self, coded: &[u8], map: &mut [u8]) -> Result<(), String> {
        let mut reader = Reader::new(coded)?;
        let (mut now, mut at) = (START, 0);
        while at < map.len() {
            let value = reader.symbol(self, now.of_value())?;
            let (mut length, bits) = length_of(reader.symbol(self, now.of_length(value))?);
            if bits > 0 {
                for (shift, bits) in parts(bits) {
                    length += reader.plain(bits)? << shift;
                }
            }
            let end = at + length;
            map.get_mut(at..end).ok_or("the runs are longer than the map")?.fill(value);
            (at, now) = (end, now.after(value));
        }
        reader.end()
    }
}

/// Divides low bits into pieces that fit a state: the shift and the number of bits of each.
fn parts(bits: u32) -> impl Iterator<Item = (u32, u32)> {
    (0..bits).step_by(BITS as usize).map(move |shift| (shift, BITS.min(bits - shift)))
}

/// Reads symbols.
struct Reader<'a> {
    state: u32,
    words: std::slice::ChunksExact<'a, u8>,
}

impl<'a> Reader<'a> {
    fn new(mut coded: &'a [u8]) -> Result<Reader<'a>, String> {
        let state = u32::from_le_bytes(take(&mut coded)?);
        if coded.len() % 2 == 1 || state < LOWEST {
            return Err("it begins or ends in the middle of a number".into());
        }
        Ok(Reader { state, words: coded.chunks_exact(2) })
    }

    #[inline]
    fn symbol(&mut self, model: &Model, situation: usize) -> Result<u8, String> {
        let slot = model.slots[situation << BITS | (self.state & (TOTAL - 1)) as usize];
        self.state = ((slot >> 20) + 1) * (self.state >> BITS) + (slot >> 8 & (TOTAL - 1));
        self.refill()?;
        Ok(slot as u8)
    }

    /// Reads bits that were stored unchanged.
    fn plain(&mut self, bits: u32) -> Result<usize, String> {
        let slot = self.state & (TOTAL - 1);
        let (part, at) = (slot >> (BITS - bits), slot & ((1 << (BITS - bits)) - 1));
        self.state = (self.state >> BITS << (BITS - bits)) + at;
        self.refill()?;
        Ok(part as usize)
    }

    #[inline]
    fn refill(&mut self) -> Result<(), String> {
        if self.state < LOWEST {
            let word = self.words.next().ok_or("it is cut off")?;
            self.state = self.state << 16 | u32::from(u16::from_le_bytes([word[0], word[1]]));
        }
        Ok(())
    }

    /// Checks that every byte was read, and that the state is the coder's initial one.
    fn end(self) -> Result<(), String> {
        if self.state == LOWEST && self.words.len() == 0 {
            Ok(())
        } else {
            Err("it does not end where its map does".into())
        }
    }
}

/// Takes the first bytes, and removes them.
pub(super) fn take<const N: usize>(bytes: &mut &[u8]) -> Result<[u8; N], String> {
    let (first, rest) = bytes.split_first_chunk().ok_or("it is cut off")?;
    *bytes = rest;
    Ok(*first)
}

/// Turns counts into shares that sum to 4,096. Each symbol that was counted has at least 1.
fn shares(counts: &[u64; 256]) -> [u16; 256] {
    let all: u64 = counts.iter().sum();
    let mut out = [0; 256];
    if all == 0 {
        out[0] = TOTAL as u16;
        return out;
    }
    let mut left = i64::from(TOTAL);
    for (share, count) in out.iter_mut().zip(counts).filter(|(_, count)| **count > 0) {
        *share = ((*count as f64 / all as f64 * f64::from(TOTAL)) as u16).max(1);
        left -= i64::from(*share);
    }
    // The remainder from rounding is added to or taken from the largest shares one by one, because their code lengths
    // change least.
    while left != 0 {
        let largest = (0..256).fold(0, |a, b| if out[b] > out[a] { b } else { a });
        let step = left.clamp(-i64::from(out[largest] / 2), left.max(0));
        out[largest] = (i64::from(out[largest]) + step) as u16;
        left -= step;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_come_back_from_their_symbols() {
        for length in (1..5000).chain((12..=26).flat_map(|e| [(1 << e) - 1, 1 << e, (1 << e) + 77])) {
            let (symbol, low, bits) = length_symbol(length);
            assert_eq!(length_of(symbol), (length - low as usize, bits), "{length}");
            assert!(usize::from(symbol) < LENGTHS);
            let whole: u32 = parts(bits).map(|(shift, bits)| (low >> shift & ((1 << bits) - 1)) << shift).sum();
            assert_eq!(whole, low);
        }
    }

    #[test]
    fn shares_sum_to_the_whole_and_leave_nothing_out() {
        let one = |of: &[(usize, u64)]| {
            let mut counts = [0; 256];
            of.iter().for_each(|(symbol, count)| counts[*symbol] = *count);
            shares(&counts)
        };
        for counts in [
            vec![],
            vec![(7, 1)],
            vec![(0, 1), (255, 1_000_000_000)],
            (0..256).map(|k| (k, 1)).collect(),
            (0..256).map(|k| (k, if k == 9 { 1 << 50 } else { 1 })).collect(),
            (0..255).map(|k| (k, (k * k) as u64)).collect(),
        ] {
            let table = one(&counts);
            assert_eq!(table.iter().map(|s| u32::from(*s)).sum::<u32>(), TOTAL, "{counts:?}");
            assert!(counts.iter().all(|(symbol, count)| (table[*symbol] > 0) == (*count > 0)));
        }
    }
}
