//! Records with faults: drift, wild readings, gaps, times of loggers, too few readings a second.

use super::reader::{MotionReading, read};
use super::*;
use mesophyll_files::table::InputTable;

const F: f64 = 1.4;
const GAMMA: f64 = 3.0;
const STEP: f64 = 0.1;
/// Twelve pulls of standard deviation 1 have a root mean square above this once in two thousand times (χ² of 12).
const CHANCE: f64 = 1.7;

fn swaying(n: usize, seed: u64) -> Vec<f64> {
    stepped(F, GAMMA, 300.0, STEP, n, seed)
}

fn of(step: f64, readings: Vec<f64>) -> MotionRecord {
    MotionRecord { step, channels: vec![readings], ..MotionRecord::default() }
}

/// The force is white, which is a wind of endless speed.
fn white() -> MotionPrior {
    MotionPrior { speed: Some(1e9), ..MotionPrior::default() }
}

/// Root mean square of (found − true)/error of resonance and damping over several motions with a fault, all of which
/// must be promised, and that all say what was taken out.
fn pulls(says: &str, seeds: std::ops::Range<u64>, fault: impl Fn(Vec<f64>, &mut Pcg64) -> Vec<f64> + Sync) -> f64 {
    let one = |seed: u64| {
        let mut rng = Pcg64::seed_from_u64(4000 + seed);
        let found = fit(&of(STEP, fault(swaying(4096, seed), &mut rng)), &white()).unwrap();
        assert!(found.status.is_ok(), "{says} {seed}: {found:?}");
        assert!(found.taken_out.iter().any(|t| t.contains(says)) || says.is_empty(), "{says} {seed}: {found:?}");
        let pull = |v: MotionEstimate, truth: f64| ((v.value - truth) / v.error).powi(2);
        pull(found.resonance, F) + pull(found.damping, GAMMA)
    };
    let count = 2.0 * (seeds.end - seeds.start) as f64;
    (seeds.into_par_iter().map(one).sum::<f64>() / count).sqrt()
}

#[test]
fn drift_is_taken_out() {
    let along = |of: fn(f64) -> f64| {
        move |r: Vec<f64>, _: &mut Pcg64| {
            let n = r.len() as f64;
            r.iter().enumerate().map(|(k, r)| r + of(k as f64 / n)).collect::<Vec<f64>>()
        }
    };
    let walk = |r: Vec<f64>, rng: &mut Pcg64| {
        let mut at = 0.0;
        r.iter()
            .map(|r| {
                at += 1.0 * normal(rng);
                r + at
            })
            .collect::<Vec<f64>>()
    };
    let all = [
        ("a line", pulls("drift", 0..6, along(|x| 300.0 * x))),
        ("warming up", pulls("drift", 20..26, along(|x| 150.0 * (-8.0 * x).exp()))),
        ("waves", pulls("drift", 40..46, along(|x| 60.0 * (14.0 * x).sin()))),
        ("a step", pulls("drift", 60..66, along(|x| if x > 0.4 { 60.0 } else { 0.0 }))),
        ("a random walk", pulls("drift", 80..86, walk)),
    ];
    println!("{all:?}");
    assert!(all.iter().all(|(_, rms)| *rms < CHANCE), "{all:?}");
}

#[test]
fn wild_readings_are_left_out() {
    for (size, count) in [(40.0, 1), (3000.0, 1), (200.0, 12)] {
        let rms = pulls("wild reading", 100..106, |mut r, rng| {
            for _ in 0..count {
                let at = (rng.random::<f64>() * r.len() as f64) as usize;
                r[at] += if rng.random::<f64>() < 0.5 { -size } else { size };
            }
            r
        });
        assert!(rms < CHANCE, "{size} {count}: {rms}");
    }
    let mut rng = Pcg64::seed_from_u64(1);
    let wild = swaying(4096, 1)
        .iter()
        .map(|r| r + if rng.random::<f64>() < 0.05 { 100.0 * normal(&mut rng) } else { 0.0 })
        .collect();
    let found = fit(&of(STEP, wild), &white()).unwrap();
    assert!(found.status.leaves_open("damping_per_s") && found.status.to_string().contains("are wild"), "{found:?}");
    // Readings that are right are left alone.
    let rms = pulls("", 120..126, |r, _| {
        assert!(cleaning::clean(&of(STEP, r.clone())).left_out.is_empty());
        r
    });
    assert!(rms < CHANCE, "{rms}");
}

#[test]
fn gaps_do_not_matter() {
    let dropped = pulls("", 140..146, |r, rng| {
        r.into_iter().map(|r| if rng.random::<f64>() < 0.2 { f64::NAN } else { r }).collect()
    });
    let paused = pulls("", 160..166, |mut r, _| {
        r[700..1500].fill(f64::NAN);
        r[2600..2900].fill(f64::NAN);
        r
    });
    assert!(dropped < CHANCE && paused < CHANCE, "{dropped} {paused}");
    let mostly: Vec<f64> =
        swaying(4096, 1).into_iter().enumerate().map(|(k, r)| if k % 3 == 0 { r } else { f64::NAN }).collect();
    assert!(fit(&of(STEP, mostly), &white()).unwrap_err().contains("expected half of them or more"));
}

/// A motion above half the rate is not called found, and one well below is not suspected.
#[test]
fn a_resonance_above_half_the_rate_is_thought_of() {
    let statuses = |f: f64, ratio: f64, rate: f64| -> Vec<String> {
        let one = |seed: u64| {
            let readings = stepped(f, ratio * 2.0 * TAU * f, 300.0, 1.0 / rate, 2000, seed);
            fit(&of(1.0 / rate, readings), &MotionPrior::default()).unwrap().status.to_string()
        };
        (0..4u64).into_par_iter().map(one).collect()
    };
    for (f, ratio, rate) in [(2.2, 0.04, 3.0), (2.2, 0.15, 3.0), (1.7, 0.08, 2.0)] {
        let all = statuses(f, ratio, rate);
        assert!(all.iter().all(|s| s.starts_with("undetermined: resonance_hz")), "{f} {ratio} {rate}: {all:?}");
    }
    for (f, ratio, rate) in [(1.0, 0.04, 10.0), (0.7, 0.15, 20.0), (2.2, 0.15, 10.0)] {
        let all = statuses(f, ratio, rate);
        let fine = |s: &&String| *s == "ok" || s.contains("a standard error above");
        // One of 12 may be accused by chance of another spectrum.
        assert!(all.iter().filter(fine).count() >= 3, "{f} {ratio} {rate}: {all:?}");
        assert!(all.iter().all(|s| !s.contains("half the sampling rate")), "{f} {ratio} {rate}: {all:?}");
    }
}

/// Readings that were copied or interpolated, and times in another unit.
#[test]
fn records_that_are_none_are_named() {
    let r = swaying(2048, 5);
    let why = |record: MotionRecord| fit(&record, &MotionPrior::default()).unwrap().status.to_string();
    let twice = r.iter().flat_map(|r| [*r, *r]).collect();
    assert!(why(of(STEP, twice)).contains("repeat the one before"));
    let between = r.windows(2).flat_map(|w| [w[0], 0.5 * (w[0] + w[1])]).collect();
    assert!(why(of(STEP, between)).contains("interpolated"));
    assert!(why(of(1e3 * STEP, r.clone())).contains("milliseconds"));
    assert!(why(of(1e-3 * STEP, r.clone())).contains("time_ms"));
    let clipped = r.iter().map(|r| r.min(12.0)).collect();
    assert!(why(of(STEP, clipped)).contains("largest value, 12 mm"));
    let mut hangs = swaying(4096, 6);
    let held = hangs[900];
    hangs[901..1000].fill(held);
    let found = fit(&of(STEP, hangs), &white()).unwrap();
    assert!(found.status.is_ok() && found.taken_out[0].contains("99 readings of u_mm that repeat"), "{found:?}");
}

fn table(rows: impl IntoIterator<Item = String>, header: &str) -> InputTable {
    let text = std::iter::once(header.to_string()).chain(rows).collect::<Vec<_>>().join("\n");
    InputTable::from_reader(Box::new(std::io::Cursor::new(text)), "sway.csv".into()).unwrap()
}

/// Times as they are written, and the record that stands behind them.
fn times(
    rate: f64,
    n: usize,
    dropped: &[usize],
    written: impl Fn(f64) -> String,
    stated: Option<f64>,
) -> MotionReading {
    let kept = (0..n).filter(|k| !dropped.contains(k));
    let rows = kept.map(|k| format!("{},{}", written(k as f64 / rate), (k as f64 * 0.37).sin()));
    let found = read(table(rows, "time_s,u_mm"), stated).unwrap();
    let u = &found.record.channels[0];
    assert!((found.record.step * rate - 1.0).abs() < 1e-3, "{} {rate}", found.record.step);
    for k in 0..n {
        let reading = u.get(k).copied().unwrap_or(f64::NAN);
        assert!(
            dropped.contains(&k) == reading.is_nan() && !((reading - (k as f64 * 0.37).sin()).abs() > 1e-12),
            "{k}"
        );
    }
    found
}

#[test]
fn times_that_loggers_write_are_put_on_a_grid() {
    let hundredths = |t: f64| format!("{t:.2}");
    let thousandths = |t: f64| format!("{t:.3}");
    let day = |t: f64| {
        // 20 seconds before midnight.
        let t = (86_380.0 + t) % 86_400.0;
        format!(
            "{:02.0}:{:02.0}:{:06.3}",
            (t / 3600.0).floor(),
            (t / 60.0).floor() % 60.0,
            ((t % 60.0) * 1e3).floor() / 1e3
        )
    };
    let dated =
        |t: f64| format!("2026-05-01T12:{:02.0}:{:06.3}Z", (t / 60.0).floor(), ((t % 60.0) * 1e3).floor() / 1e3);
    let dropped = [5, 100, 101, 102, 777, 900];
    for gone in [&[][..], &dropped[..]] {
        times(30.0, 1500, gone, hundredths, None);
        times(29.97, 1500, gone, hundredths, None);
        times(333.0, 3000, gone, thousandths, None);
        times(240.0, 3000, gone, thousandths, None);
        times(20.0, 1500, gone, day, None);
        times(20.0, 1500, gone, dated, None);
        times(20.0, 1500, gone, |t| format!("{}", 1e9 + t), None);
        times(30.0, 1500, gone, hundredths, Some(30.0));
    }
    // Times in whole seconds tell nothing but how long the record is.
    times(20.0, 1500, &[], |t| format!("{:.0}", t.floor()), Some(20.0));
    let rows = (0..400).map(|k| format!("{},{}", 50 * k, (f64::from(k) * 0.37).sin()));
    assert!((read(table(rows, "time_ms,u_mm"), None).unwrap().record.step - 0.05).abs() < 1e-12);
}

/// A cell that is none costs itself, and what is wrong with times is named with its line.
#[test]
fn faults_of_a_table_are_named() {
    let row = |k: usize| format!("{:.3},{:.3}", k as f64 * 0.05, (k as f64 * 0.3).sin());
    let with = |k: usize, text: &str| {
        let text = text.to_string();
        (0..500usize).map(move |j| if j == k { text.clone() } else { row(j) })
    };
    let header = "time_s,u_mm";
    for (cell, note) in [
        ("7.500,NA", "without a reading"),
        ("7.500,-9999", "without a reading"),
        ("7.500,x", "u_mm is \"x\""),
        ("7.500", "1 fields"),
    ] {
        let found = read(table(with(150, cell), header), None).unwrap();
        let at = &found.record.channels[0];
        assert!(at[150].is_nan() && at.len() == 500 && at.iter().filter(|r| r.is_nan()).count() == 1, "{cell}");
        assert!(found.notes.len() == if cell == "7.500" { 2 } else { 1 }, "{:?}", found.notes);
        assert!(found.notes.iter().any(|n| n.contains("line 152") && n.contains(note)), "{cell}: {:?}", found.notes);
    }
    let found = read(table(with(150, "7.450,1"), header), None).unwrap();
    assert!(found.notes.iter().any(|n| n.contains("goes back") && n.contains("line 152")), "{:?}", found.notes);
    let failed = |rows: Vec<String>| read(table(rows, header), None).unwrap_err().to_string();
    // The gap is on line 302, and its length is said.
    let late =
        (0..500usize).map(|k| format!("{:.3},1", k as f64 * 0.05 + if k >= 300 { 9000.0 } else { 0.0 })).collect();
    let why = failed(late);
    assert!(why.contains("line 302") && why.contains("9000.050"), "{why}");
    let back = (0..500usize).map(|k| format!("{:.3},1", (k % 250) as f64 * 0.05)).collect();
    let why = failed(back);
    assert!(why.contains("line 252") && why.contains("after 12.45"), "{why}");
    let mut rng = Pcg64::seed_from_u64(3);
    let ragged = (0..500usize)
        .map(|k| format!("{:.3},1", k as f64 * 0.05 + 0.015 * normal(&mut rng).clamp(-1.0, 1.0)))
        .collect();
    assert!(failed(ragged).contains("--rate"));
    assert!(failed(vec!["1,1".into(), "1,2".into(), "1,3".into()]).contains("times that rise"));
    assert!(failed(vec!["a,1".into(), "b,2".into()]).contains("line 2: time_s"));
}
