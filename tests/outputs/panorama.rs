//! A sky fitted to a panorama, from the picture to the report.

use crate::common::{refused, run, succeeded};
use serde_json::Value;

/// From a picture with a known answer to the fit and its report. What cannot be read is refused by a sentence.
#[test]
fn a_panorama_is_made_fitted_and_reported() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_string();
    let (picture, out) = (at("p.exr"), at("fit"));
    let sun = ["--sun-zenith-deg", "50", "--sun-azimuth-deg", "-100", "--turbidity", "3"];
    let make = |extra: &[&str]| {
        let mut args = vec!["eval", "panorama", "--quiet", "-o", picture.as_str()];
        args.extend(sun);
        args.extend(extra);
        succeeded(&run(args));
    };
    make(&["--noise", "0.02", "--size", "96x48", "--scale", "0.5"]);
    let ran = run(["fit", "sky", "--quiet", "--json", "--panorama", &picture, "-o", &out]);
    succeeded(&ran);
    let json: Value = serde_json::from_slice(&ran.stdout).unwrap();
    for (name, truth) in [("sun_zenith_deg", 50.0), ("sun_azimuth_deg", -100.0), ("turbidity", 3.0), ("scale", 0.5)] {
        let (value, error) = (json[name]["value"].as_f64().unwrap(), json[name]["stderr"].as_f64().unwrap());
        assert!((value - truth).abs() < 5.0 * error && error > 0.0, "{name}: {value} ± {error}");
    }
    assert_eq!(json["status"], "ok");
    assert!(json["sun_from"] == "sky" && json["disk"].as_str().unwrap().starts_with("not seen"), "{json}");
    let report = run(["report", &out, "--json"]);
    succeeded(&report);
    let report: Value = serde_json::from_slice(&report.stdout).unwrap();
    assert_eq!(report["verdict"]["level"], "good", "{report}");
    succeeded(&run(["report", &out, "-o", &at("report.html")]));
    assert!(
        !std::fs::read_to_string(at("report.html")).unwrap().contains("no name in this version"),
        "a figure without a name"
    );
    // A second run gives the same bytes.
    let first = std::fs::read(dir.path().join("fit/fit.toml")).unwrap();
    succeeded(&run(["fit", "sky", "--quiet", "--panorama", &picture, "-o", &out]));
    assert_eq!(std::fs::read(dir.path().join("fit/fit.toml")).unwrap(), first);
    // The sky of another model is not accepted as good.
    make(&["--model", "hosek-wilkie", "--noise", "0.01", "--size", "96x48"]);
    let ran = run(["fit", "sky", "--quiet", "--json", "--panorama", &picture, "-o", &out]);
    let json: Value = serde_json::from_slice(&ran.stdout).unwrap();
    assert!(
        json["status"]
            .as_str()
            .unwrap()
            .starts_with("undetermined: sun_zenith_deg; sun_azimuth_deg; turbidity; scale (the model")
    );
    let report: Value = serde_json::from_slice(&run(["report", &out, "--json"]).stdout).unwrap();
    assert_eq!(report["verdict"]["level"], "bad");
    // With its disk the same sky has its sun.
    make(&["--model", "hosek-wilkie", "--noise", "0.01", "--size", "96x48", "--disk"]);
    let ran = run(["fit", "sky", "--quiet", "--json", "--panorama", &picture, "-o", &out]);
    let json: Value = serde_json::from_slice(&ran.stdout).unwrap();
    assert_eq!(json["sun_from"], "disk", "{json}");
    assert!(json["status"].as_str().unwrap().starts_with("undetermined: turbidity; scale (the model"), "{json}");
    for (name, truth) in [("sun_zenith_deg", 50.0), ("sun_azimuth_deg", -100.0)] {
        let (value, error) = (json[name]["value"].as_f64().unwrap(), json[name]["stderr"].as_f64().unwrap());
        assert!((value - truth).abs() < 3.0 * error && error < 3.0, "{name}: {value} ± {error}");
    }
    refused(
        &run(["fit", "sky", "--panorama", &picture, "--channels", "R,G,X", "-o", &out]),
        2,
        &["X", "no such channel"],
    );
    refused(
        &run(["fit", "sky", "--panorama", &picture, "--projection", "fisheye", "-o", &out]),
        2,
        &["96 x 48", "square"],
    );
    refused(&run(["fit", "sky", "--panorama", &at("none.exr"), "-o", &out]), 2, &["none.exr"]);
    refused(
        &run(["eval", "panorama", "--sun-zenith-deg", "95", "--turbidity", "3", "-o", &picture]),
        2,
        &["below the horizon"],
    );
}
