"""Remove Unused Caches."""

from bpy.types import Operator

from ..core.errors import plain
from ..scene import cache_files


class ANYFACE_OT_remove_unused_caches(Operator):
    """Delete cache files that neither this file nor a .blend near it plays"""

    bl_idname = "anyface.remove_unused_caches"
    bl_label = "Remove Unused Caches"
    bl_options = {"REGISTER"}

    def invoke(self, context, event):
        """Says how many files there are, and asks whether to delete them."""
        try:
            unused = cache_files.unused()
        except BaseException as error:
            return self._fail(plain(error))
        if not unused.files:
            return self.execute(context)
        self._words = f"Delete {len(unused.files)} files ({unused.megabytes:,.0f} MB)?"
        return context.window_manager.invoke_props_dialog(self, title=self.bl_label)

    def draw(self, context):
        """Shows how many files will be deleted."""
        self.layout.label(text=self._words, icon="TRASH")
        self.layout.label(text="No .blend near them plays them. Undo cannot bring them back.")

    def execute(self, context):
        """Deletes them."""
        try:
            unused = cache_files.unused()
            cache_files.delete(unused.files)
        except BaseException as error:
            return self._fail(plain(error))
        if unused.unread:
            text = f"{unused.unread[0].name} cannot be read here: caches beside it stay"
            self.report({"WARNING"}, f"Anyface: {text}")
        self.report({"INFO"}, f"Anyface: {len(unused.files)} unused caches deleted")
        return {"FINISHED"}

    def _fail(self, error):
        self.report({"ERROR"}, f"Anyface: {error}")
        return {"CANCELLED"}
