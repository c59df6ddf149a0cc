//! Writers of the forms, from their definitions; no file of an instrument is copied.

use std::fmt::Write;

/// A leaf's spectrum for tests: green, with the red edge; in shares.
pub fn leaf(w: f64) -> f64 {
    let green = 0.08 * (-((w - 550.0) / 40.0).powi(2)).exp();
    let edge = 0.42 / (1.0 + (-(w - 715.0) / 12.0).exp());
    0.05 + green + edge * (1.0 - 0.6 * (-((w - 1450.0) / 60.0).powi(2)).exp())
}

/// Wavelengths of three detectors that overlap: 340 to 1010, 970 to 1911 and 1900 to 2515 nm.
pub fn three_detectors() -> Vec<f64> {
    let range = |from: f64, step: f64, n: usize| (0..n).map(move |k| from + step * k as f64);
    range(340.0, 1.5, 448).chain(range(970.0, 3.6, 262)).chain(range(1900.0, 2.5, 247)).collect()
}

/// A `.sig` file: `scale` is 100 for per cent; the second detector reads `step` times as much.
pub fn sig(wavelengths: &[f64], scale: f64, step: f64) -> String {
    let mut text = String::from(
        "/*** Spectra Vista SIG Data ***/\r\nname= maple.000.sig\r\ninstrument= HI: 1234567 (HR-1024i)\r\n\
         integration= 70.0, 9.0, 7.0, 200.0, 30.0, 7.0\r\nunits= Radiance, Radiance\r\ncomm= a = b\r\n\
         factors= 1.08, 1.13, 1.0 [Overlap: Preserve, Matching Type: None]\r\ndata= \r\n",
    );
    let mut detector = 0;
    for (k, w) in wavelengths.iter().enumerate() {
        detector += usize::from(k > 0 && *w <= wavelengths[k - 1]);
        let (white, r) = (1000.0 + w, leaf(*w) * if detector == 1 { step } else { 1.0 });
        writeln!(text, "{w:.1}  {white:.2}  {:.4}  {:.4}\r", white * r, scale * r).unwrap();
    }
    text
}

/// A `.sed` file with these columns behind `Wvl`; `value` gives a cell by column and wavelength.
pub fn sed(measurement: &str, columns: &[&str], value: impl Fn(usize, f64) -> f64) -> String {
    let mut text = format!(
        "Comment: \r\nVersion: 2.2\r\nFile Name: C:\\leaf.sed\r\nInstrument: PSR+3500_SN1 [3]\r\nDetectors: \
         512,256,256\r\nMeasurement: {measurement}\r\nTime: 12:00:33,12:05:44\r\nUnits: None\r\nWavelength Range: \
         350,2500\r\nChannels: 2151\r\nColumns [{}]:\r\nData:\r\nWvl\t{}\r\n",
        columns.len() + 1,
        columns.join("\t")
    );
    for w in 350..=2500 {
        let cells = (0..columns.len()).map(|k| format!("{:.6E}", value(k, f64::from(w)))).collect::<Vec<_>>();
        write!(text, " {w}.0\t{}\r\n", cells.join("\t")).unwrap();
    }
    text
}

/// How an `.asd` file is written.
#[derive(Clone)]
pub struct Asd {
    pub version: u8,
    pub data_type: u8,
    /// 0 float, 1 integer, 2 double.
    pub format: u8,
    pub dark_corrected: bool,
    pub saturation: u8,
    pub start: f32,
    pub step: f32,
    pub spectrum: Vec<f64>,
    pub white: Option<Vec<f64>>,
    pub description: &'static str,
}

impl Asd {
    /// Counts of a leaf and of its reference in a file of version 8.
    pub fn counts() -> Asd {
        let white: Vec<f64> = (0..2151).map(|k| 20_000.0 + 5.0 * f64::from(k)).collect();
        let spectrum = white.iter().enumerate().map(|(k, w)| w * leaf(350.0 + k as f64)).collect();
        Asd {
            version: 8,
            data_type: 0,
            format: 2,
            dark_corrected: true,
            saturation: 0,
            start: 350.0,
            step: 1.0,
            spectrum,
            white: Some(white),
            description: "panel",
        }
    }

    pub fn bytes(&self) -> Vec<u8> {
        let mut header = vec![0u8; 484];
        let magic = if self.version == 1 { "ASD".to_string() } else { format!("as{}", self.version) };
        header[..3].copy_from_slice(magic.as_bytes());
        header[3..12].copy_from_slice(b"a comment");
        (header[178], header[179]) = (0x60, self.version << 4);
        header[181] = u8::from(self.dark_corrected);
        header[186] = self.data_type;
        header[191..195].copy_from_slice(&self.start.to_le_bytes());
        header[195..199].copy_from_slice(&self.step.to_le_bytes());
        header[199] = self.format;
        header[204..206].copy_from_slice(&(self.spectrum.len() as u16).to_le_bytes());
        header[390..394].copy_from_slice(&68u32.to_le_bytes());
        header[422] = self.saturation;
        header[444..448].copy_from_slice(&1000f32.to_le_bytes());
        header[448..452].copy_from_slice(&1800f32.to_le_bytes());
        let value = |v: &f64| match self.format {
            0 => (*v as f32).to_le_bytes().to_vec(),
            1 => (*v as i32).to_le_bytes().to_vec(),
            _ => v.to_le_bytes().to_vec(),
        };
        let mut bytes = header;
        bytes.extend(self.spectrum.iter().flat_map(value));
        if self.version >= 2 {
            bytes.extend(if self.white.is_some() { [0xff, 0xff] } else { [0, 0] });
            bytes.extend(40_015.5f64.to_le_bytes());
            bytes.extend(40_015.6f64.to_le_bytes());
            bytes.extend((self.description.len() as i16).to_le_bytes());
            bytes.extend(self.description.as_bytes());
            bytes.extend(self.white.clone().unwrap_or(vec![0.0; self.spectrum.len()]).iter().flat_map(value));
        }
        bytes
    }
}

/// Mode, tag and values in per cent of a row.
type Ci710Row<'a> = (&'a str, &'a str, &'a dyn Fn(f64) -> f64);

/// A CI-710s table with these rows; `separator` is a comma, or a semicolon with decimal commas.
pub fn ci710(separator: &str, rows: &[Ci710Row]) -> String {
    let number = |v: f64| {
        let text = format!("{v:.6}");
        if separator == "," { text } else { text.replace('.', ",") }
    };
    let wavelengths: Vec<f64> = (0..1600).map(|k| 150.0 + 0.75 * f64::from(k)).collect();
    let names = ["Date", "Mode", "IntegrationTime(ms)", "Smoothing", "Tag", "Version", "Wavelengths(nm)"];
    let across = wavelengths.iter().map(|w| number(*w)).collect::<Vec<_>>().join(separator);
    let mut text = format!("{}{separator}{across}{separator}\r\n", names.join(separator));
    for (mode, tag, value) in rows {
        let cells = ["3/8/2022 3:02:47 PM", mode, "0", "0", tag, "0.9.38.0", ""];
        let values = wavelengths.iter().map(|w| number(value(*w))).collect::<Vec<_>>().join(separator);
        write!(text, "{}{separator}{values}\r\n", cells.join(separator)).unwrap();
    }
    text
}

/// An `.rxt` file: the header's 17 numbers, one a line, then the legend and the readings.
pub fn rxt(header: [f64; 17], comment: &str, legend: &str, readings: &str) -> String {
    let numbers: String = header.iter().map(|v| format!("{v}   # of the header\n")).collect();
    format!("IAD1   # first four characters\n# {comment}\n\n{numbers}\n{legend}\n#lambda r t\n{readings}")
}

/// A header for a bare sample of index 1.4 and a thickness of 2.5 mm.
pub fn header(spheres: f64) -> [f64; 17] {
    [1.4, 1.0, 2.5, 0.0, 5.0, 0.98, spheres, 200.0, 20.0, 10.0, 5.0, 0.97, 200.0, 20.0, 0.0, 5.0, 0.97]
}
