//! Takes over changes of the scene that is set: changes of its lights, its time and its materials.

use super::Renderer;
use crate::error::Result;
use crate::guard::Guard;
use crate::material::MaterialOnGpu;
use crate::passes::backdrop::BackdropPass;
use crate::passes::main::Pipelines;
use crate::passes::transfer::Lit;
use crate::scene::{Scene, SkyDome, WindState};
use crate::validation;
use crate::variant::{Variant, shadow_layers};

impl Renderer {
    /// Shows the pictures that follow as checks compare them, or as the scene says.
    pub fn show_plain(&mut self, plain: bool) {
        self.tonemap.plain(&self.gpu, plain);
    }

    /// Takes over a change of lights, background or exposure, with meshes, materials and instances as they were. A sun
    /// that moves makes the shadow maps be drawn again; all other changes cost nothing. A light that appears or
    /// disappears reloads the scene, because other maps are needed then.
    pub fn set_lights(&mut self, scene: &Scene) -> Result<()> {
        let same = self.loaded.as_ref().is_some_and(|l| {
            l.sun.is_some() == scene.sun.is_some()
                && l.sky.is_some() == scene.sky.is_some()
                && l.dome.is_some() == scene.dome.is_some()
                && l.look.is_some() == scene.dome.as_ref().is_some_and(|d| d.picture.is_some())
                && l.scanner.is_some() == scene.scanner.is_some()
                && l.transfer.is_some() == scene.transfer.is_some()
                && l.sun_shares.as_ref().map(|s| s.len()) == scene.sun_shares.as_ref().map(|s| s.len())
                && l.shadow_layers == shadow_layers(scene)
                && l.shadow_resolution == scene.shadow_resolution
                && l.msaa == scene.msaa
                && l.bloom.as_ref().map(|b| b.share) == scene.bloom
        });
        if !same {
            return self.set_scene(scene);
        }
        validation::lights(&self.gpu, scene)?;
        let Some(loaded) = &mut self.loaded else { return Ok(()) };
        if let (Some(sun), Some(shadow)) = (scene.sun, &mut loaded.shadow)
            && loaded.sun.is_none_or(|old| old.direction != sun.direction || old.radius != sun.radius)
        {
            loaded.shadow_texel = shadow.set_sun(&self.gpu, &sun, &loaded.casters);
        }
        (loaded.sun, loaded.sky, loaded.background) = (scene.sun, scene.sky, scene.background);
        loaded.scanner = scene.scanner;
        if let Some(dome) = &scene.dome {
            loaded.main.set_dome(&self.gpu, dome);
            let shown = |d: &SkyDome| d.picture.as_ref().map(|p| std::sync::Arc::as_ptr(&p.texels));
            if let Some(picture) =
                dome.picture.as_ref().filter(|_| loaded.dome.as_ref().map(shown) != Some(shown(dome)))
            {
                loaded.look = Some(BackdropPass::new(&self.gpu, picture, scene.msaa, &mut self.stats));
            }
        }
        if let Some(transfer) = &mut loaded.transfer {
            transfer.set_light(&self.gpu, &Lit::of(scene), &mut self.stats);
        }
        loaded.dome = scene.dome.clone();
        if let Some(shares) = scene.sun_shares.as_ref().filter(|_| loaded.sun_shares != scene.sun_shares) {
            loaded.main.set_shares(&self.gpu, shares);
            loaded.sun_shares = scene.sun_shares.clone();
        }
        self.tonemap.set(&self.gpu, scene.exposure, scene.display);
        Ok(())
    }

    /// Takes over another time of the wind. Everything that sections carry moves, and its shadows with it.
    pub fn set_time(&mut self, wind: &WindState) {
        let Some(loaded) = &mut self.loaded else { return };
        if let Some(grass) = &mut loaded.grass {
            grass.time = wind.time_s;
        }
        let Some(bend) = &loaded.bend else { return };
        if let Some(pose) = &bend.pose {
            pose.set_time(&self.gpu, wind.time_s);
            if let Some(shadow) = &mut loaded.shadow {
                shadow.forget();
            }
            return;
        }
        let now = loaded.extents.at(Some(wind));
        bend.set_times(&self.gpu, &[now.sections]);
        (loaded.casters, loaded.ball) = (now.casters, now.ball);
        if let (Some(sun), Some(shadow)) = (loaded.sun, &mut loaded.shadow) {
            loaded.shadow_texel = shadow.set_sun(&self.gpu, &sun, &loaded.casters);
        }
    }

    /// Takes over a change of material `index`, with meshes, masks and instances as they were. Only changed data are
    /// uploaded: where a slider moves a curve, the curve, and no map that is unchanged.
    ///
    /// # Errors
    /// As [`Renderer::set_scene`].
    pub fn set_material(&mut self, scene: &Scene, index: usize) -> Result<()> {
        validation::material(&self.gpu, scene, index)?;
        let Some(loaded) = &mut self.loaded else { return self.set_scene(scene) };
        let Some(before) = loaded.materials.get(index).and_then(Option::as_ref) else { return Ok(()) };
        let guard = Guard::new(&self.gpu);
        let (gpu, stats) = (&self.gpu, &mut self.stats);
        let mut new = None;
        for batch in loaded.batches.iter_mut().filter(|b| b.material == index) {
            let Some(variant) = Variant::new(gpu, scene, &batch.of(scene)) else { continue };
            batch.variant = variant;
            self.pipelines.need(gpu, &variant, stats);
            new.get_or_insert_with(|| {
                let (material, tables) = (&scene.materials[index], &mut self.tables);
                MaterialOnGpu::new(gpu, index, material, &variant, &self.samplers, tables, Some(before), stats)
            });
        }
        for batch in loaded.batches.iter_mut().filter(|b| b.material == index) {
            batch.complete(gpu, scene, stats);
        }
        for (i, mesh) in loaded.meshes.iter_mut().enumerate() {
            if let Some(mesh) = mesh {
                mesh.complete(gpu, i, &scene.meshes[i], &loaded.batches, stats);
            }
        }
        if let Err(error) = guard.finish(&self.gpu) {
            self.pipelines = Pipelines::default();
            self.loaded = None;
            return Err(error);
        }
        if new.is_some() {
            loaded.materials[index] = new;
        }
        if let Some(mut shadow) = loaded.shadow.take() {
            shadow.bind_masks(&self.gpu, loaded.drawn(), &self.samplers);
            loaded.shadow = Some(shadow);
        }
        Ok(())
    }
}
