"""Videos by ffmpeg, called as a process where it is installed."""

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from coslobe.core.errors import CoslobeError
from coslobe.core.files import atomic_path


def find_ffmpeg() -> str | None:
    """The path of ffmpeg, or None."""
    return shutil.which("ffmpeg")


def write_video(path: Path, pictures: Sequence[Path], fps: float, ffmpeg: str) -> None:
    """Join PNG pictures of one size into an H.264 video (yuv420p, crf 16); odd sizes get a black edge.

    Raises
    ------
    CoslobeError
        ffmpeg fails; the message carries its last line.
    """
    with atomic_path(path) as temporary, tempfile.TemporaryFile() as complaints:
        command = [ffmpeg, "-y", "-loglevel", "error", "-f", "image2pipe", "-c:v", "png"]
        command += ["-framerate", f"{fps:g}", "-i", "-"]
        # Rec.709, and said so: players would otherwise guess the matrix from the size.
        command += ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv"]
        command += ["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"]
        command += ["-c:v", "libx264", "-crf", "16", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
        process = subprocess.Popen([*command, str(temporary)], stdin=subprocess.PIPE, stderr=complaints)
        assert process.stdin is not None
        try:
            for picture in pictures:
                process.stdin.write(picture.read_bytes())
            process.stdin.close()
        except BrokenPipeError:  # ffmpeg has given up and says why
            pass
        except BaseException:
            process.kill()
            raise
        if process.wait() != 0:
            complaints.seek(0)
            lines = complaints.read().decode(errors="replace").strip().splitlines()
            raise CoslobeError(f"{path}: ffmpeg failed ({lines[-1] if lines else 'without a word'})")
