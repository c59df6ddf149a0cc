use super::*;

fn sample() -> ChannelMaps {
    let mut maps = ChannelMaps::new(5, 40);
    for (k, name) in ["rho_d.R", "m.Y"].iter().enumerate() {
        maps.push(*name, (0..200).map(|i| i as f32 * 0.5 + k as f32).collect());
    }
    maps
}

#[test]
fn rows_and_channels_read_back_exactly() {
    let dir = tempfile::tempdir().unwrap();
    for packing in [Packing::Raw, Packing::Zip] {
        let path = dir.path().join("a.exr");
        write_exr(&path, &sample(), packing).unwrap();
        assert_eq!(read_exr_rows(&path, Some(&["rho_d.R", "m.Y"]), None).unwrap(), sample());
        let band = read_exr_rows(&path, Some(&["m.Y"]), Some(17..23)).unwrap();
        assert_eq!(band.channels[0].1, sample().channels[1].1[17 * 5..23 * 5]);
    }
}

/// A window that reaches from 15 back to 2²⁷, or down to 2³⁰, is refused before memory is asked for. The largest
/// compression that there is passes: all pixels are the same.
#[test]
fn a_header_that_states_more_than_the_file_can_hold_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    write_exr(&path, &sample(), Packing::Raw).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let name = b"dataWindow\0box2i\0";
    let window = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4;
    for (at, value) in [(0, 1 << 27), (12, 1 << 30)] {
        let mut broken = bytes.clone();
        broken[window + at..window + at + 4].copy_from_slice(&i32::to_le_bytes(value));
        std::fs::write(&path, broken).unwrap();
        let clock = std::time::Instant::now();
        let sentence = read_exr(&path).unwrap_err().to_string();
        assert!(sentence.contains("a.exr") && clock.elapsed().as_secs() < 2, "{sentence}");
    }
    let mut even = ChannelMaps::new(2000, 2000);
    even.push("Y", vec![0.0; 4_000_000]);
    write_exr(&path, &even, Packing::Zip).unwrap();
    assert!(std::fs::metadata(&path).unwrap().len() < 4 * 4_000_000 / 200);
    assert_eq!(read_exr(&path).unwrap(), even);
    // The same for a large picture asks for memory that the file does not justify.
    let mut even = ChannelMaps::new(12_000, 6000);
    even.push("Y", vec![0.0; 12_000 * 6000]);
    write_exr(&path, &even, Packing::Zip).unwrap();
    let sentence = read_exr(&path).unwrap_err().to_string();
    assert!(sentence.contains("12000x6000 pixels") && sentence.contains("274 MiB"), "{sentence}");
}

#[test]
fn a_truncated_file_is_a_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    write_exr(&path, &sample(), Packing::Raw).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    for keep in [0, 3, 20, 100, bytes.len() / 2, bytes.len() - 7] {
        std::fs::write(&path, &bytes[..keep]).unwrap();
        let sentence = read_exr(&path).unwrap_err().to_string();
        assert!(sentence.contains("a.exr"), "{sentence}");
    }
}
