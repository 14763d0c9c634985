"""Models: the folder of weights that replace the built-in ones, and the models' cards."""

from bpy.types import Panel

from ..core import model_card
from . import preferences, words
from .panel import OfFacePanel


class ANYFACE_PT_models(OfFacePanel, Panel):
    """Shows which weights are used."""

    bl_label = "Models"
    bl_order = 20
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Draws the folder, and each model in it with a button that opens its card."""
        layout, width = self.layout, context.region.width
        layout.use_property_split, layout.use_property_decorate = True, False
        usual = preferences.usual_folder() or "Built-In"
        layout.prop(context.scene.anyface, "model_folder", placeholder=usual)
        folder = preferences.model_folder(context.scene)
        if folder is None:
            layout.label(text="The built-in models speak", icon="INFO")
            return
        cards = model_card.cards(folder)
        if not cards:
            words.draw(_tight(layout), f"No models in {folder}", width, "ERROR")
        for card in cards:
            row = layout.row()
            words.draw(_tight(row), card.title, width - 30, "FILE_TEXT")
            if card.path is not None:
                shown = row.operator("wm.path_open", text="", icon="HELP", emboss=False)
                shown.filepath = str(card.path)


def _tight(layout):
    """A column whose lines stand close together, so that they read as one text."""
    column = layout.column(align=True)
    column.scale_y = 0.7
    return column
