"""Sums of cosine lobes as a BSDF for Mitsuba 3, which has none of its own.

This file knows nothing of the rest of coslobe: it goes along with exported scenes as `render.py`, where
`python render.py [SAMPLES] [VARIANT]` renders scene.xml beside it to scene.exr and scene.png.
"""

import json
import sys
from pathlib import Path
from typing import Any

PLUGIN = "coslobe_lobe_sum"


def register(mitsuba: Any) -> None:
    """Make the plugin known to `mitsuba`, whose variant must be set.

    Its parameter `terms` is JSON: a list of {colour: [r, g, b], c: [x, y, z], exponent, cosine, normalised},
    which stand for colour max(x v_x l_x + y v_y l_y + z v_z l_z, 0)^exponent in the shading frame, whose z is
    the normal, times the cosine l_z where `cosine` is true, and times (exponent + 2) / (2 pi) where
    `normalised` is. The name of one of the plugin's textures may stand for a colour or a number.
    """
    import drjit

    class LobeSum(mitsuba.BSDF):
        def __init__(self, properties: Any) -> None:
            mitsuba.BSDF.__init__(self, properties)
            self.terms: Any = json.loads(properties["terms"])
            names = [name for name in properties.keys() if name.startswith("texture_")]  # noqa: SIM118
            self.textures = {name: properties[name] for name in names}
            reflection = mitsuba.BSDFFlags.GlossyReflection | mitsuba.BSDFFlags.FrontSide
            self.m_flags = reflection
            self.m_components = [reflection]

        def _colour(self, value: Any, interaction: Any, active: Any) -> Any:
            if isinstance(value, str):
                return self.textures[value].eval(interaction, active)
            return mitsuba.Color3f(value)

        def _number(self, value: Any, interaction: Any, active: Any) -> Any:
            if isinstance(value, str):
                return self.textures[value].eval(interaction, active)[0]
            return mitsuba.Float(value)

        def _lobe(self, term: Any, interaction: Any, active: Any) -> tuple[Any, Any]:
            """The vector w of the lobe (w.l)^exponent, and the exponent."""
            view = interaction.wi
            x, y, z = (self._number(part, interaction, active) for part in term["c"])
            axis = mitsuba.Vector3f(x * view.x, y * view.y, z * view.z)
            return axis, self._number(term["exponent"], interaction, active)

        def _scale(self, term: Any, exponent: Any) -> Any:
            return (exponent + 2) / (2 * drjit.pi) if term["normalised"] else 1.0

        def _is_constant(self, term: Any) -> bool:
            return term["exponent"] == 0 and term["cosine"]

        def eval(self, context: Any, interaction: Any, light: Any, active: Any = True) -> Any:
            value = mitsuba.Color3f(0)
            for term in self.terms:
                axis, exponent = self._lobe(term, interaction, active)
                cosine = drjit.dot(axis, light)
                lobe = drjit.select(cosine > 0, drjit.power(drjit.maximum(cosine, 1e-20), exponent), 0)
                colour = self._colour(term["colour"], interaction, active) * self._scale(term, exponent)
                value += colour * (lobe * light.z if term["cosine"] else lobe)
            return drjit.select(active & (interaction.wi.z > 0) & (light.z > 0), value, mitsuba.Color3f(0))

        def pdf(self, context: Any, interaction: Any, light: Any, active: Any = True) -> Any:
            density = mitsuba.Float(0)
            for term in self.terms:
                if self._is_constant(term):
                    density += mitsuba.warp.square_to_cosine_hemisphere_pdf(light)
                else:
                    axis, exponent = self._lobe(term, interaction, active)
                    cosine = drjit.maximum(drjit.dot(drjit.normalize(axis), light), 1e-20)
                    density += (exponent + 1) / (2 * drjit.pi) * drjit.power(cosine, exponent)
            return drjit.select(active & (interaction.wi.z > 0), density / len(self.terms), 0)

        def eval_pdf(self, context: Any, interaction: Any, light: Any, active: Any = True) -> Any:
            value = self.eval(context, interaction, light, active)
            return value, self.pdf(context, interaction, light, active)

        def sample(
            self, context: Any, interaction: Any, choice: Any, position: Any, active: Any = True
        ) -> tuple[Any, Any]:
            light: Any = mitsuba.warp.square_to_cosine_hemisphere(position)
            for k, term in enumerate(self.terms):
                if not self._is_constant(term):
                    axis, exponent = self._lobe(term, interaction, active)
                    up: Any = drjit.power(drjit.maximum(1 - position.x, 1e-20), 1 / (exponent + 1))
                    across = drjit.safe_sqrt(1 - up * up)
                    turn = 2 * drjit.pi * position.y
                    frame = mitsuba.Frame3f(drjit.normalize(axis))
                    found = frame.to_world(
                        mitsuba.Vector3f(across * drjit.cos(turn), across * drjit.sin(turn), up)
                    )
                    chosen = (choice * len(self.terms) >= k) & (choice * len(self.terms) < k + 1)
                    light = drjit.select(chosen, found, light)
            result = mitsuba.BSDFSample3f()
            result.wo = light
            result.pdf = self.pdf(context, interaction, light, active)
            result.eta = 1.0
            result.sampled_type = mitsuba.UInt32(+mitsuba.BSDFFlags.GlossyReflection)
            result.sampled_component = mitsuba.UInt32(0)
            value = self.eval(context, interaction, light, active)
            good = active & (result.pdf > 0)
            weight = drjit.select(good, value / drjit.maximum(result.pdf, 1e-20), mitsuba.Color3f(0))
            return result, weight

        def traverse(self, callback: Any) -> None:
            pass

    mitsuba.register_bsdf(PLUGIN, LobeSum)


if __name__ == "__main__":
    import mitsuba as renderer

    renderer.set_variant(sys.argv[2] if len(sys.argv) > 2 else "scalar_rgb")
    register(renderer)
    folder = Path(__file__).parent
    image = renderer.render(renderer.load_file(str(folder / "scene.xml")), spp=int([*sys.argv, "0"][1]))
    for suffix in ("exr", "png"):
        renderer.util.write_bitmap(str(folder / f"scene.{suffix}"), image)
