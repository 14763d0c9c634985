"""The shots of a jobs file as a job of OpenCue, a chunk of rows a frame.

    python submit.py            hands it in, to the Cuebot of CUEBOT_HOSTS
    python submit.py --print    prints the job's description instead

It needs `pip install opencue-pyoutline`. `anyface batch --export opencue` fills in: name, program,
arguments (the command of a node), rows, chunk (rows a frame), memory_mb, cores.
"""

import shlex
import sys

import outline
import outline.cuerun
from outline.modules.shell import Shell

COMMAND = [{{program}}, {{arguments}}]
ROWS, CHUNK = {{rows}}, {{chunk}}


def build():
    """The job: its rows, and a layer after them that writes the sum of all reports.

    That layer waits for frames that are dead: retry or eat them.
    """
    job = outline.Outline("{{name}}")
    total = layer("sum", "1-1", 1, "--sum")
    whole = ROWS // CHUNK * CHUNK
    # Many Cuebots give #FRAME_END# of a last chunk that is shorter as if it were whole, so what is
    # left over is a layer of its own.
    for name, first, last in (("shots", 1, whole), ("rest", whole + 1, ROWS)):
        if first <= last:
            size = min(CHUNK, last - first + 1)
            rows = layer(name, f"{first}-{last}", size, "--rows", "#FRAME_START#-#FRAME_END#")
            job.add_layer(rows)
            total.depend_all(rows)
    job.add_layer(total)
    return job


def layer(name, frames, chunk, *words):
    """A layer whose frames run the command with more words."""
    # Cuebot replaces its tokens in the whole text, and the host gives that to a shell.
    text = [word if word[0] == "#" else shlex.quote(word) for word in (*COMMAND, *words)]
    shell = Shell(
        name,
        command=text,
        range=frames,
        chunk=chunk,
        cores={{cores}},
        memory="{{memory_mb}}m",
        threadable={{cores}} > 1,
    )
    shell.set_env("RAYON_NUM_THREADS", "{{cores}}")
    return shell


if __name__ == "__main__":
    launcher = outline.cuerun.OutlineLauncher(build())
    if sys.argv[1:] == ["--print"]:
        print(launcher.serialize(use_pycuerun=False))
    else:
        launcher.launch(use_pycuerun=False)
