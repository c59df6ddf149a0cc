//! `mesophyll eval sky`: sun and turbidity in, spherical harmonics of the sky out, N² rows for each row.

use crate::named::named;
use crate::{Common, batch, tables};
use crate::{Error, Result};
use mesophyll_files::progress;
use mesophyll_files::table::{self, Answer, BatchIo, Spec, Table};
use mesophyll_fit_sky::window::WindowKind;
use mesophyll_fit_sky::{self as fits, Form, Method, Options, SkyModel};
use mesophyll_sky::harmonics::MOST_BANDS;
use mesophyll_sky::{Coefficients, Model, Refused, irradiance, project};
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

/// CSV columns `sun_zenith,turbidity` (radians; a column `sun_zenith_deg` is in degrees) → N² rows
/// `sun_zenith,turbidity,index,r,g,b,status` for each.
///
/// Real orthonormal harmonics of the upper hemisphere, zero below the horizon: no Condon-Shortley phase, index
/// l(l+1)+m, z up, sun at azimuth 0 = +x, kcd/m², linear sRGB, not clamped. The default evaluates the fit (turbidity
/// 2.5 to 6, up to 7 bands); what it does not cover is integrated directly, and a message says so.
#[derive(Debug, clap::Args)]
#[command(after_long_help = tables::help("eval sky"))]
pub struct Args {
    #[command(flatten)]
    io: BatchIo,
    /// Bands N: l < N
    #[arg(
        long,
        value_name = "N",
        default_value_t = 7,
        value_parser = clap::value_parser!(u16).range(1..=MOST_BANDS as i64)
    )]
    bands: u16,
    /// fit: fitted polynomials, 1e-5; compact: half the size, 1e-4; direct: integrated, 1e-9; the others fit Preetham
    /// as a black box
    #[arg(long, value_enum, default_value_t = MethodName::Fit)]
    method: MethodName,
    /// The sky; hosek-wilkie needs --method direct
    #[arg(long, value_parser = named::<SkyModel>(), default_value_t = SkyModel::Preetham)]
    model: SkyModel,
    /// Ground albedo of hosek-wilkie, 0 to 1
    #[arg(long, value_name = "A", default_value_t = 0.2)]
    albedo: f64,
    /// Factors against ringing; fitted: as shallow as lanczos at less loss, positive: no ringing at all
    #[arg(long, value_parser = named::<WindowKind>(), default_value_t = WindowKind::None)]
    window: WindowKind,
    /// Light from level ground of this albedo, 0 to 1, below the horizon (of the sky alone: the sun is not part of it)
    #[arg(long, value_name = "A", default_value_t = 0.0)]
    ground: f64,
    /// Evaluate the fit in this folder (see `fit sky`) in place of the built-in one
    #[arg(long, value_name = "DIR", conflicts_with_all = ["method", "model"])]
    fit: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum MethodName {
    #[value(alias = "fine")]
    Fit,
    Compact,
    Direct,
    Chebyshev,
    MonomialsQr,
}

pub fn run(args: &Args, common: &Common) -> Result<u8> {
    let model = args.model.over(args.albedo)?;
    let bands = usize::from(args.bands);
    if !(0.0..=1.0).contains(&args.ground) {
        return Err(Error::Usage(format!("--ground is {}; expected an albedo of 0 to 1", args.ground)));
    }
    // The ground's light is the irradiance of two bands at least.
    let worked = if args.ground > 0.0 { bands.max(2) } else { bands };
    let window = args.window.window(bands)?;
    let form = polynomials(args, worked)?;
    let table = Table::open(&args.io.input)?;
    let (sun_column, sun_unit) = table.angle("sun_zenith")?;
    let spec = Spec {
        required: vec![sun_column.clone(), "turbidity".into()],
        outputs: ["index", "r", "g", "b"].map(String::from).to_vec(),
        whole: vec!["index".into()],
        ..Spec::default()
    };
    let (beyond, warned) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let tally = table::run(table, &args.io.rows(common.json), &spec, |row, out| {
        let (sun, turbidity) = (sun_unit * row.get(0), row.get(1));
        let fitted = form
            .as_ref()
            .filter(|f| f.bands() >= worked && (f.turbidities()[0]..=f.turbidities()[1]).contains(&turbidity));
        let answer = match fitted {
            Some(form) => form.coefficients(sun, turbidity),
            None => integrated(model.as_ref(), sun, turbidity, worked).inspect(|_| {
                beyond.fetch_add(usize::from(form.is_some()), Ordering::Relaxed);
            }),
        };
        match answer {
            Ok(mut c) => {
                if args.ground > 0.0 {
                    c = irradiance::add_ground(&c, [args.ground; 3], [0.0; 3]);
                }
                if let Some(window) = &window {
                    c = window.apply(&c.truncated(bands));
                }
                warned.fetch_add(usize::from(model.warning(turbidity).is_some()), Ordering::Relaxed);
                let values = c.values().iter().take(bands * bands).enumerate();
                out.extend(values.map(|(k, v)| Answer::ok(vec![k as f64, v[0], v[1], v[2]])));
            }
            Err(_) if sun_unit != 1.0 && !(0.0..=90.0).contains(&row.get(0)) => {
                out.push(Answer::refused(format!(
                    "{sun_column} is {}; expected 0 (zenith) to 90 (horizon)",
                    row.get(0)
                )));
            }
            Err(why) => out.push(Answer::refused(why.to_string())),
        }
    })?;
    let (beyond, warned) = (beyond.into_inner(), warned.into_inner());
    if warned > 0 {
        let [low, high] = model.trusted();
        progress::say(format!(
            "warning: {warned} skies have a turbidity outside the {low} to {high} for which {} is trusted",
            model.name()
        ));
    }
    if beyond > 0 {
        progress::say(format!("outside what the fit covers, integrated directly (skies: {beyond})"));
    }
    batch::say_tally(&tally, &args.io, common, "row")?;
    Ok(0)
}

fn integrated(model: &dyn Model, sun: f64, turbidity: f64, bands: usize) -> std::result::Result<Coefficients, Refused> {
    Ok(project::direct(model.sky(sun, turbidity)?.as_ref(), bands))
}

/// The polynomials that the arguments ask for; `None` where everything is to be integrated.
fn polynomials(args: &Args, bands: usize) -> Result<Option<Form<f32>>> {
    if let Some(folder) = &args.fit {
        let (record, form) = fits::folder::read(folder)?;
        if record.options.get("model").map(String::as_str) != Some("preetham") {
            return Err(Error::field(
                &folder.join("fit.toml"),
                "model",
                "expected preetham, whose skies stand in where the fit ends",
            ));
        }
        return Ok(Some(form));
    }
    if args.method == MethodName::Direct {
        return Ok(None);
    }
    if args.model != SkyModel::Preetham {
        return Err(Error::Usage("--model hosek-wilkie needs --method direct; the fits are of preetham".into()));
    }
    let method = match args.method {
        MethodName::Fit if bands <= 7 => return Ok(Some(Form::Folded(fits::standard()?.clone()))),
        MethodName::Fit | MethodName::Direct => Method::Fine,
        MethodName::Compact => Method::Compact,
        MethodName::Chebyshev => Method::Chebyshev,
        MethodName::MonomialsQr => Method::MonomialsQr,
    };
    if bands > fits::MOST_BANDS {
        // the default gives way; a fit asked for by name does not
        if args.method == MethodName::Fit {
            progress::say(format!(
                "{bands} bands are more than a fit has ({}); everything is integrated directly",
                fits::MOST_BANDS
            ));
            return Ok(None);
        }
        return Err(Error::Usage(format!(
            "--bands {bands} with --method {}: expected at most {}",
            method.name(),
            fits::MOST_BANDS
        )));
    }
    let fitted = fits::fit(&Options { method, bands, ..Options::default() })?;
    let failed = || Error::Missed(format!("{} failed: {}", method.name(), fitted.remark));
    Ok(Some(fitted.form.as_ref().ok_or_else(failed)?.narrow()))
}
