import subprocess
import sys

import tactopose_drake as tp


def test_the_core_needs_no_pydrake() -> None:
    code = """
import importlib, pathlib, sys, types
root = pathlib.Path(sys.argv[1])
package = types.ModuleType("tactopose_drake")
package.__path__ = [str(root)]
sys.modules["tactopose_drake"] = package
sys.modules["pydrake"] = None
names = ["tactopose_drake." + ".".join(p.relative_to(root).with_suffix("").parts) for p in root.glob("core/**/*.py")]
for name in names:
    importlib.import_module(name.removesuffix(".__init__"))
print(len(names))
"""
    root = str(tp.__path__[0])
    done = subprocess.run([sys.executable, "-c", code, root], capture_output=True, text=True, check=True)
    assert int(done.stdout) > 20
