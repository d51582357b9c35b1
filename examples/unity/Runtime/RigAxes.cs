using UnityEngine;

namespace Tensionlab
{
    /// <summary>
    /// Axes of a rig, right-handed, beside Unity's, left-handed, in which y points up and z ahead. Ahead turns its
    /// sign; then the axes take each other's places in turn, until up is the rig's: with Y up, (x, y, z) of Unity
    /// is (x, y, -z) of the rig; with Z up it is (-z, x, y).
    /// </summary>
    public sealed class RigAxes
    {
        readonly double[][] rows;  // of the matrix from Unity's axes to the rig's

        /// <param name="up">As the bridge says it: "x", "y", "z", "-z"; null for y.</param>
        /// <param name="dimension">2 for a rig in the plane of Unity's x and y.</param>
        public RigAxes(string up, int dimension)
        {
            up = string.IsNullOrEmpty(up) ? "y" : up;
            int upward = "xyz".IndexOf(up[up.Length - 1]);
            rows = new double[dimension][];
            if (dimension == 2)
            {
                rows[0] = upward == 1 ? new double[] { 1, 0, 0 } : new double[] { 0, 1, 0 };
                rows[1] = upward == 1 ? new double[] { 0, 1, 0 } : new double[] { -1, 0, 0 };
            }
            else
            {
                double[][] mirrored = { new double[] { 1, 0, 0 }, new double[] { 0, 1, 0 }, new double[] { 0, 0, -1 } };
                for (int i = 0; i < 3; i++) rows[(i + upward + 2) % 3] = mirrored[i];
            }
            if (up[0] != '-') return;
            foreach (int row in new[] { upward, (upward + 1) % dimension })
                for (int j = 0; j < 3; j++)
                    rows[row][j] *= -1;
        }

        public int Dimension { get { return rows.Length; } }

        /// <summary>A place or a direction in the rig's axes.</summary>
        public double[] FromUnity(Vector3 vector)
        {
            var turned = new double[rows.Length];
            for (int i = 0; i < rows.Length; i++)
                turned[i] = rows[i][0] * vector.x + rows[i][1] * vector.y + rows[i][2] * vector.z + 0.0;
            return turned;
        }

        /// <summary>Lengths along the axes, which have no sign.</summary>
        public double[] Lengths(Vector3 lengths)
        {
            double[] turned = FromUnity(lengths);
            for (int i = 0; i < turned.Length; i++) turned[i] = System.Math.Abs(turned[i]);
            return turned;
        }

        /// <summary>An orientation in space, x, y, z, w: turns go the other way round in axes of the other hand.</summary>
        public double[] FromUnity(Quaternion turn)
        {
            double[] axis = FromUnity(new Vector3(turn.x, turn.y, turn.z));
            return new[] { -axis[0], -axis[1], -axis[2], turn.w };
        }

        /// <summary>The first numbers of a place, a force or a wrench in Unity's axes.</summary>
        public Vector3 ToUnity(double[] vector)
        {
            double x = 0, y = 0, z = 0;
            for (int i = 0; i < rows.Length && i < vector.Length; i++)
            {
                x += rows[i][0] * vector[i];
                y += rows[i][1] * vector[i];
                z += rows[i][2] * vector[i];
            }
            return new Vector3((float)x, (float)y, (float)z);
        }
    }
}
