"""What people built or brought, and stones: models that stand on z = 0 around their own origin.

Buildings are of class "building", vehicles and people of "vehicle or person", rocks and heaps of
earth of "ground", all else of "man-made".
"""
