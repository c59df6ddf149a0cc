//! Checks sun, sky, day, camera and the light between leaves. A physical sky needs a sun, and only under a physical sky
//! can the sun move.

use super::place::ManifestText;
use crate::manifest::{PhysicalSky, Result, SceneDay, SceneSky};
use mesophyll_sky::{SkyModel, preetham};

pub fn lights(p: &ManifestText) -> Result<()> {
    if let Some(sun) = &p.manifest.sun {
        p.range("[sun]", 0, "zenith_deg", sun.zenith_deg, [0.0, 180.0], "degrees")?;
        p.finite("[sun]", 0, "azimuth_deg", &[sun.azimuth_deg])?;
        sun.irradiance().map_or(Ok(()), |irradiance| p.colour("[sun]", "irradiance", &irradiance))?;
        p.range("[sun]", 0, "radius_deg", sun.radius_deg, [0.0, 45.0], "degrees")?;
    }
    if let Some(sky) = &p.manifest.sky {
        one_sky(p, sky)?;
    }
    if p.manifest.sun_moves() && p.manifest.physical_sky().is_none() {
        let (header, key) = if p.manifest.day.is_some() { ("[day]", "") } else { ("[sun]", "moves") };
        return Err(p.error(
            header,
            0,
            key,
            "given, but only a scene with a physical sky (sky.model) has a sun that moves",
        ));
    }
    if let Some(day) = &p.manifest.day {
        one_day(p, day)?;
    }
    if let Some(camera) = &p.manifest.camera {
        const HEADER: &str = "[camera]";
        p.range(HEADER, 0, "f_number", camera.f_number, [0.5, 256.0], "of a lens")?;
        p.range(HEADER, 0, "shutter_s", camera.shutter_s, [1e-6, 3600.0], "seconds")?;
        p.range(HEADER, 0, "iso", camera.iso, [1.0, 1e6], "of a sensor")?;
        if p.manifest.physical_sky().is_none() {
            let why = "given, but only under a physical sky is the unit of light known; expected exposure instead";
            return Err(p.error(HEADER, 0, "", why));
        }
    }
    if let Some(transfer) = &p.manifest.transfer {
        const HEADER: &str = "[transfer]";
        for n in transfer.anchors {
            p.range(HEADER, 0, "anchors", n as f64, [1.0, 64.0], "anchors along a leaf or across it")?;
        }
        p.range(HEADER, 0, "paths", f64::from(transfer.paths), [16.0, f64::from(1 << 19)], "paths an anchor")?;
        p.range(HEADER, 0, "edge_mm", transfer.edge_mm, [0.01, 1e4], "mm")?;
        if let Some(bands) = transfer.bands {
            p.range(HEADER, 0, "bands", bands as f64, [1.0, 7.0], "bands")?;
        }
        if transfer.shared && p.manifest.instances.iter().all(|i| i.positions.is_none() && i.list.is_none()) {
            let why = "true, but no [[instance]] has a list of positions, whose copies would share their light";
            return Err(p.error(HEADER, 0, "shared", why));
        }
        for (given, what) in [
            (p.manifest.periodic.is_some(), "in a scene that repeats"),
            (p.manifest.panorama().is_some(), "under an environment map"),
            (p.manifest.leaves.iter().any(|l| l.discs.is_some()), "between leaves of discs"),
        ] {
            if given {
                let why = format!("given, but the real-time renderer, which it is for, draws no such light {what}");
                return Err(p.error(HEADER, 0, "", why));
            }
        }
    }
    if p.manifest.sun.is_none() && p.manifest.sky.is_none() {
        return Err(p.error("", 0, "sun", "missing, and no [sky] either; expected some light"));
    }
    Ok(())
}

fn one_sky(p: &ManifestText, sky: &SceneSky) -> Result<()> {
    const HEADER: &str = "[sky]";
    let PhysicalSky { model, turbidity, ground_albedo, scale } = match sky {
        SceneSky::Even(radiance) => return p.colour(HEADER, "radiance", radiance),
        SceneSky::Picture(sky) => {
            if sky.sun.is_some() && p.manifest.sun.is_some() {
                let why = "found \"in the picture\", but the scene has a [sun]; expected one of the two";
                return Err(p.error(HEADER, 0, "sun", why));
            }
            p.finite(HEADER, 0, "rotation_deg", &[sky.rotation_deg.unwrap_or(0.0)])?;
            let unit = "factor on the picture's radiance";
            return sky.scale.map_or(Ok(()), |scale| p.positive(HEADER, 0, "scale", scale, unit));
        }
        SceneSky::Physical(sky) => *sky,
    };
    let Some(sun) = &p.manifest.sun else {
        return Err(p.error(HEADER, 0, "model", "given without a [sun]; a physical sky needs one"));
    };
    let above = "degrees (the sun of a physical sky stands above the horizon)";
    p.range("[sun]", 0, "zenith_deg", sun.zenith_deg, [0.0, 90.0], above)?;
    if p.manifest.sun_moves() && model == SkyModel::Preetham {
        let unit = "where the sun moves (what the polynomials were fitted to)";
        p.range(HEADER, 0, "turbidity", turbidity, preetham::TRUSTED, unit)?;
    }
    let turbidities = model.over(0.0).map_or(preetham::TURBIDITIES, |model| model.turbidities());
    p.range(HEADER, 0, "turbidity", turbidity, turbidities, "")?;
    for albedo in ground_albedo.iter().flatten() {
        p.range(HEADER, 0, "ground_albedo", *albedo, [0.0, 1.0], "a channel")?;
    }
    scale.map_or(Ok(()), |scale| p.positive(HEADER, 0, "scale", scale, "number of scene units a kcd/m\u{b2}"))
}

fn one_day(p: &ManifestText, day: &SceneDay) -> Result<()> {
    const HEADER: &str = "[day]";
    p.range(HEADER, 0, "latitude_deg", day.latitude_deg, [-90.0, 90.0], "degrees")?;
    p.range(HEADER, 0, "declination_deg", day.declination_deg, [-23.45, 23.45], "degrees")?;
    if day.hours.is_empty() || day.hours.len() > 64 {
        return Err(p.error(HEADER, 0, "hours", format!("found {} of them, expected 1 to 64", day.hours.len())));
    }
    for hour in &day.hours {
        p.range(HEADER, 0, "hours", *hour, [0.0, 24.0], "hours")?;
        if day.sun(*hour).0 > std::f64::consts::FRAC_PI_2 + 1e-9 {
            return Err(p.error(
                HEADER,
                0,
                "hours",
                format!("the sun is below the horizon at {hour}, expected hours of daylight"),
            ));
        }
    }
    Ok(())
}
