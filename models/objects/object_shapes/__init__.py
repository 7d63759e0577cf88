"""The shapes of the shipped objects, as closed triangle meshes in metres; `catalogue.CATALOGUE` lists them all."""
