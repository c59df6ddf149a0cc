//! Buffer views that meshoptimizer compressed (`EXT_meshopt_compression`, `KHR_meshopt_compression`).

use serde_json::Value;

/// The names of the extension.
pub(super) const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// A byte of compressed data stands for at most this many. The codec writes a block of 8 kB as two bytes for each of
/// its rows of four bytes at least; what promises more is damaged.
const MOST_BYTES_A_BYTE: usize = 4096;

/// A vertex of `N` · 4 bytes.
#[derive(Clone)]
struct Row<const N: usize>([u32; N]);

impl<const N: usize> Default for Row<N> {
    fn default() -> Self {
        Row([0; N])
    }
}

/// The bytes that a view's `packed` bytes stand for, `count` times `stride` of them. `said` is the extension's object.
///
/// # Errors
/// What is wrong, as the rest of a sentence.
pub(super) fn unpack(said: &Value, packed: &[u8]) -> Result<Vec<u8>, String> {
    let number = |key: &str| said[key].as_u64().ok_or_else(|| format!("{key}: missing, expected a whole number"));
    let (count, stride) = (number("count")? as usize, number("byteStride")? as usize);
    let whole = count.checked_mul(stride).filter(|n| n / MOST_BYTES_A_BYTE <= packed.len());
    if whole.is_none() {
        return Err(format!("found {count} entries of {stride} bytes in {} bytes (damaged)", packed.len()));
    }
    let mode = said["mode"].as_str().unwrap_or_default();
    let unpacked = match (mode, stride) {
        ("ATTRIBUTES", _) => rows(packed, count, stride),
        ("TRIANGLES", 2) if count.is_multiple_of(3) => meshopt::decode_index_buffer(packed, count).ok().map(short),
        ("TRIANGLES", 4) if count.is_multiple_of(3) => meshopt::decode_index_buffer(packed, count).ok().map(long),
        ("INDICES", 2) => meshopt::decode_index_sequence(packed, count).ok().map(short),
        ("INDICES", 4) => meshopt::decode_index_sequence(packed, count).ok().map(long),
        _ => return Err(format!("found mode \"{mode}\" with a byteStride of {stride}, which nothing decompresses")),
    };
    let mut bytes = unpacked.ok_or_else(|| "its compressed data is damaged".to_string())?;
    let filter = said["filter"].as_str().unwrap_or("NONE");
    match (filter, stride) {
        ("NONE", _) => {}
        ("OCTAHEDRAL", 4) => each(&mut bytes, i8::from_le_bytes, i8::to_le_bytes, meshopt::decode_filter_oct),
        ("OCTAHEDRAL", 8) => each(&mut bytes, i16::from_le_bytes, i16::to_le_bytes, meshopt::decode_filter_oct),
        ("QUATERNION", 8) => each(&mut bytes, i16::from_le_bytes, i16::to_le_bytes, meshopt::decode_filter_quat),
        ("COLOR", 4) => each(&mut bytes, u8::from_le_bytes, u8::to_le_bytes, meshopt::decode_filter_color),
        ("COLOR", 8) => each(&mut bytes, u16::from_le_bytes, u16::to_le_bytes, meshopt::decode_filter_color),
        ("EXPONENTIAL", _) if stride.is_multiple_of(4) => {
            each(&mut bytes, u32::from_le_bytes, u32::to_le_bytes, meshopt::decode_filter_exp::<1>);
        }
        _ => return Err(format!("found filter \"{filter}\" with a byteStride of {stride}, which nothing undoes")),
    }
    Ok(bytes)
}

fn short(list: Vec<u16>) -> Vec<u8> {
    list.into_iter().flat_map(u16::to_le_bytes).collect()
}

fn long(list: Vec<u32>) -> Vec<u8> {
    list.into_iter().flat_map(u32::to_le_bytes).collect()
}

/// Applies a filter to groups of `N` numbers of `B` bytes.
fn each<T: Copy + Default, const B: usize, const N: usize>(
    bytes: &mut [u8],
    read: fn([u8; B]) -> T,
    write: fn(T) -> [u8; B],
    filter: impl Fn(&mut [[T; N]]),
) {
    let (all, _) = bytes.as_chunks::<B>();
    let numbers: Vec<T> = all.iter().map(|b| read(*b)).collect();
    let mut groups: Vec<[T; N]> = numbers.as_chunks::<N>().0.to_vec();
    filter(&mut groups);
    for (to, from) in bytes.as_chunks_mut::<B>().0.iter_mut().zip(groups.iter().flatten()) {
        *to = write(*from);
    }
}

/// Vertices of a stride that is known when the program runs, by the decoder for this stride.
fn rows(packed: &[u8], count: usize, stride: usize) -> Option<Vec<u8>> {
    fn of<const N: usize>(packed: &[u8], count: usize) -> Option<Vec<u8>> {
        let rows: Vec<Row<N>> = meshopt::decode_vertex_buffer(packed, count).ok()?;
        // The decoder writes bytes, whatever the order in which this machine has those of a number.
        Some(rows.into_iter().flat_map(|row| row.0).flat_map(u32::to_ne_bytes).collect())
    }
    macro_rules! strides {
        ($($n:literal)*) => {
            match stride {
                $(s if s == 4 * $n => of::<$n>(packed, count),)*
                _ => None,
            }
        };
    }
    strides!(1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32 33 34 35 36 37 38
        39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63 64)
}
